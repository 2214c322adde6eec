// Continuing from the gamepad after a stop: its resume button is held for a second while the stick is centred, and
// released. The release counts: a disconnected gamepad may keep its last state for ever, and so never releases. Pure.

export const HOLD_MS = 1000
/** Two samples farther apart do not prove that the button was held in between [ms]. */
const GAP_MS = 200

export interface Press {
  /** What the button would do; empty: nothing. */
  what: string
  /** Whether the button was up since then: one that was held before does not count. */
  fresh: boolean
  /** Since when it is held [ms]; NaN: it is not, or does not count. */
  since: number
  /** Time of this sample [ms]. */
  at: number
}

export const NO_PRESS: Press = { what: '', fresh: false, since: NaN, at: -Infinity }

/** What the resume button would do now; empty: nothing. last: the mode the operator drove in before, or empty. */
export function next(drives: boolean, stopped: boolean, mode: string, last: string): string {
  if (!drives) return ''
  if (stopped) return 'reset'
  return mode === 'hold' ? last : ''
}

/** The press after this sample. */
export function pressed(before: Press, what: string, down: boolean, now: number): Press {
  if (what === '') return { ...NO_PRESS, at: now }
  if (!down) return { what, fresh: true, since: NaN, at: now }
  const counts = continues(before, what, now) && before.fresh
  return { what, fresh: counts, since: counts && Number.isNaN(before.since) ? now : counts ? before.since : NaN, at: now }
}

/** What to do at this sample, where a press of sufficient length ends; empty: nothing. */
export function due(before: Press, what: string, down: boolean, now: number): string {
  return !down && continues(before, what, now) && before.at - before.since >= HOLD_MS ? what : ''
}

/** The hint for the operator; empty: none. button, then: its name, and what it does. */
export function hint(press: Press, button: string, then: string): string {
  if (press.what === '') return ''
  if (!Number.isNaN(press.since)) return press.at - press.since < HOLD_MS ? `hold ${button} …` : `release ${button}: ${then}`
  return press.fresh ? `hold ${button} for a second, stick centred, and release it: ${then}` : `release ${button} first`
}

function continues(before: Press, what: string, now: number): boolean {
  return what !== '' && before.what === what && now - before.at < GAP_MS
}
