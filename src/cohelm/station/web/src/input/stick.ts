// A stick: its reading, the shape of its deflection, whether it still sends, and whether it is armed. Pure, so that
// it can be tested.
import type { Command, Status } from '../messages'

/** Deflection fore-aft and left-right, forward and left positive, [-1, 1]. */
export type Stick = Command['stick']
/** What a device gives: its deflection, or why there is none, which is not the same as centred. */
export type Reading = Stick | string

export const CENTRED: Stick = [0, 0]

export type Device = 'none' | 'keyboard' | 'gamepad' | 'touch'

export const DEVICE_NAMES: Record<Device, string> = {
  none: 'no stick', keyboard: 'keyboard', gamepad: 'gamepad', touch: 'touch or mouse',
}

// --- dead band and expo curve of a raw deflection

export interface Shape {
  /** Deflections up to this are none, [0, 0.5]. */
  deadBand: number
  /** 0 straight .. 1 cubic: fine near the centre. */
  curve: number
}

export function clamp(value: number, low: number, high: number): number {
  return Math.min(Math.max(value, low), high)
}

/** Odd, continuous, 0 inside the dead band, ±1 at the ends. NaN stays NaN. */
export function shaped(raw: number, { deadBand, curve }: Shape): number {
  const size = clamp(Math.abs(raw), 0, 1)
  if (size <= deadBand) return 0
  const x = (size - deadBand) / (1 - deadBand)
  const y = (1 - curve) * x + curve * x * x * x
  return raw < 0 ? -y : y
}

/** `from` moved towards `to` by at most `step`. */
export function towards(from: number, to: number, step: number): number {
  return from + clamp(to - from, -step, step)
}

/** The share of the full speed that was kept as text; 1 for what is none. */
export function sharedSpeed(text: string | null): number {
  const share = Number(text ?? NaN)
  return share >= 0.1 && share <= 1 ? share : 1
}

// --- whether a gamepad still sends
//
// The receiver of a gamepad that is out of range, or whose battery is flat, keeps the last deflection. Browsers set
// `timestamp` at each change of the gamepad; some leave it at 0, so another timestamp or another value counts as a
// change.

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

// --- arming: the stick must have been centred since it was connected before it steers
//
// The robot has the same rule; this copy shows the operator the result at once.

export type Arming = Status['arming']

/** The next state, from the device's reading. */
export function arm(before: Arming, reading: Reading): Arming {
  if (typeof reading === 'string' || !reading.every(Number.isFinite)) return 'absent'
  if (before === 'armed') return 'armed'
  return centred(reading) ? 'armed' : 'waiting'
}

/** Deflections up to this are centred; as on the robot, which a test holds. */
export const CENTRE = 0.1

export function centred(stick: Stick): boolean {
  return stick.every((axis) => Math.abs(axis) <= CENTRE)
}

export function deflected(reading: Reading): boolean {
  return typeof reading !== 'string' && !centred(reading)
}

/** What the operator must do first for a deflected stick to steer; empty: nothing. lease: for the right to drive; empty: it
 * is there. */
export function needed(lease: string, stopped: boolean, mode: string): string {
  if (lease !== '') return lease
  if (stopped) return 'press Reset first'
  if (mode === 'hold') return 'mode is Hold; release it, then choose Shared or Manual'
  if (mode === 'automatic') return 'mode is Auto; release it, then choose Shared or Manual'
  return ''
}
