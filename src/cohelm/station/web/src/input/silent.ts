// Whether a gamepad still sends. The receiver of a gamepad that is out of range, or whose battery is flat,
// keeps the last deflection. Browsers set `timestamp` at each change of the gamepad; some leave it at 0, so
// another timestamp or another value counts as a change. Pure, so that it can be tested.

/** A hand on a partly deflected stick trembles by more than one count of any converter, many times
 * a second: a stick without a change for longer is not held [s]. */
export const HELD_S = 3
/** At the end of its travel, where the converter saturates, and on a pad of switches, a held stick
 * does not change; longer than this is not accepted there either [s]. */
export const AT_END_S = 10
const END = 0.98

export interface LastChange {
  /** When the gamepad last changed [ms]. */
  at: number
  /** Its content then. */
  content: string
}

export const NO_CHANGE: LastChange = { at: 0, content: '' }

interface Pad {
  readonly timestamp: number
  readonly index: number
  readonly axes: readonly number[]
  readonly buttons: readonly { readonly value: number }[]
}

/** The last change, including the gamepad's present state. now: [ms]. */
export function lastChange(before: LastChange, pad: Pad | null, now: number): LastChange {
  if (pad === null) return NO_CHANGE
  const content = JSON.stringify([pad.index, pad.timestamp, pad.axes, pad.buttons.map((b) => b.value)])
  return content === before.content ? before : { at: now, content }
}

/** Time without a change in whole seconds, where it is too long for a hand; else 0.
 * fore, left: raw axes, 0 where they are not deflected. */
export function silentFor(changed: LastChange, fore: number, left: number, now: number): number {
  const size = (axis: number) => Math.abs(axis)
  const deflected = [fore, left].filter((axis) => size(axis) > 0)
  if (deflected.length === 0) return 0
  const most = deflected.every((axis) => size(axis) >= END) ? AT_END_S : HELD_S
  const silence = (now - changed.at) / 1000
  return silence > most ? Math.floor(silence) : 0
}
