// Whether a gamepad still speaks. A receiver whose pad is out of reach, or whose battery is flat, keeps
// showing the last deflection. Browsers set `timestamp` when something of the pad changed; some leave
// it at 0, so what counts as new is another timestamp or another value. Pure, so that it can be tested.

/** A hand that holds a stick part of the way trembles by more than a count of any converter, many
 * times a second; after so long it is none [s]. */
export const HELD_S = 3
/** At the end of its travel, where a converter saturates, and on a pad of switches, a stick that is
 * held says nothing; nobody drives blind for longer than this [s]. */
export const AT_END_S = 10
const END = 0.98

export interface Heard {
  /** When the pad last said something new [ms]. */
  at: number
  /** What it said. */
  said: string
}

export const NOTHING: Heard = { at: 0, said: '' }

interface Pad {
  readonly timestamp: number
  readonly index: number
  readonly axes: readonly number[]
  readonly buttons: readonly { readonly value: number }[]
}

/** What was heard of the pad, with what it says now [ms]. */
export function heardOf(before: Heard, pad: Pad | null, now: number): Heard {
  if (pad === null) return NOTHING
  const said = JSON.stringify([pad.index, pad.timestamp, pad.axes, pad.buttons.map((b) => b.value)])
  return said === before.said ? before : { at: now, said }
}

/** For how long it has said nothing new, in whole seconds, where that is too long for a hand; else 0.
 * fore, left: raw axes, 0 where they are not deflected. */
export function silentFor(heard: Heard, fore: number, left: number, now: number): number {
  const size = (axis: number) => Math.abs(axis)
  const deflected = [fore, left].filter((axis) => size(axis) > 0)
  if (deflected.length === 0) return 0
  const most = deflected.every((axis) => size(axis) >= END) ? AT_END_S : HELD_S
  const silence = (now - heard.at) / 1000
  return silence > most ? Math.floor(silence) : 0
}
