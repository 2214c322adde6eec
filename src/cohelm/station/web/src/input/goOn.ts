// Driving on from the gamepad after a stop: its go-on button is held for a second while the stick is centred, and let
// go. Letting go is what counts: a pad out of reach shows the last it said for ever, and so never lets go. Pure, so
// that it can be tested.

export const HOLD_MS = 1000
/** Looks farther apart than this do not show that a button was held in between [ms]. */
const GAP_MS = 200

export interface Press {
  /** What the button would do; empty: nothing. */
  what: string
  /** Whether it was up since it would do this: a button that was held before counts for nothing. */
  fresh: boolean
  /** Since when it is held [ms]; NaN: it is not, or counts for nothing. */
  since: number
  /** Of this look [ms]. */
  at: number
}

export const NO_PRESS: Press = { what: '', fresh: false, since: NaN, at: -Infinity }

/** What the go-on button would do now; empty: nothing. last: the mode the person drove in before, or empty. */
export function next(drives: boolean, stopped: boolean, mode: string, last: string): string {
  if (!drives) return ''
  if (stopped) return 'reset'
  return mode === 'hold' ? last : ''
}

/** The press as of this look. */
export function pressed(before: Press, what: string, down: boolean, now: number): Press {
  if (what === '') return { ...NO_PRESS, at: now }
  if (!down) return { what, fresh: true, since: NaN, at: now }
  const goesOn = goesOnFrom(before, what, now) && before.fresh
  return { what, fresh: goesOn, since: goesOn && Number.isNaN(before.since) ? now : goesOn ? before.since : NaN, at: now }
}

/** What is to be done at this look, when a press that was held long enough ends; empty: nothing. */
export function due(before: Press, what: string, down: boolean, now: number): string {
  return !down && goesOnFrom(before, what, now) && before.at - before.since >= HOLD_MS ? what : ''
}

/** What to tell the person; empty: nothing. button, then: its name, and what it would do. */
export function hint(press: Press, button: string, then: string): string {
  if (press.what === '') return ''
  if (!Number.isNaN(press.since)) return press.at - press.since < HOLD_MS ? `hold ${button} …` : `let ${button} go: ${then}`
  return press.fresh ? `hold ${button} for a second, stick centred, and let it go: ${then}` : `let ${button} go first`
}

function goesOnFrom(before: Press, what: string, now: number): boolean {
  return what !== '' && before.what === what && now - before.at < GAP_MS
}
