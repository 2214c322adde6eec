// Why the applied command differs from the nominal one.

import { centred } from '../input/stick.ts' // with its ending, which Node needs that tests this
import type { Status } from '../messages'

/** Nearer than this is close [m]. */
export const CLOSE_M = 0.25

type Steered = Pick<Status, 'mode' | 'localised' | 'authority' | 'e_p'>

/** Whether there is only the stick, however little it is deflected: in manual mode, where the localization is lost, and
 * in shared mode without a route to follow, where there is no tracking error. */
function stickAlone({ mode, localised, e_p }: Steered): boolean {
  return mode === 'manual' || (mode === 'shared' && (localised === 'lost' || e_p === null))
}

/** The person's share of the command, in [0, 1]; null: nobody commands, as in hold, and while the robot pauses. */
export function operatorsShare(state: Steered | null): number | null {
  if (state === null || state.mode === 'hold' || state.authority === null) return null
  if (state.mode === 'automatic') return 0
  return stickAlone(state) ? 1 : 1 - state.authority
}

/** Who reads it: the driver; somebody while nobody drives, or another; or nobody who can do anything, as in a replay. */
export type Reader = 'driver' | 'anyone' | 'other' | 'nobody'

/** What to do next where the robot is stopped, or has no command, as the gate says it. */
const NEXT: { [state: string]: Record<Reader, string> } = {
  stopped: {
    driver: 'stopped: press Reset, then choose a mode', anyone: 'stopped: press Take over, then Reset',
    other: 'stopped: its driver can reset it', nobody: 'stopped',
  },
  idle: {
    driver: 'idle: choose a mode', anyone: 'idle: press Take over, then choose a mode', other: 'idle', nobody: 'idle',
  },
}

/** The robot's reason at the end of its route: nothing is wrong. */
const DONE = 'the route is done'

const GUARDED: Partial<Record<Status['verdict'], string>> = {
  shaped: 'limited: obstacle near',
  braking: 'braking: obstacle near',
  standing: 'standing: no safe motion',
}

/** Said whatever the numbers are: one that is not finite is none here, and what can not be filtered passes as it is. */
const UNFILTERED: Partial<Record<Status['verdict'], string>> = {
  invalid: 'standing: invalid number (NaN or infinite)',
  powerless: 'the safety filter can not act here: steer away',
}

type Command = [number, number]

/** Whether one command is visibly not the other. */
function differ(one: Command, other: Command): boolean {
  return Math.abs(one[0] - other[0]) > 0.02 || Math.abs(one[1] - other[1]) > 0.05
}

/** Why the applied command is not the nominal one; where it is, what to do. */
export interface Reason {
  text: string
  /** 0: nothing holds it back but the robot's own limits; 1: it is held back; 2: it is braked, refused or stopped. */
  weight: 0 | 1 | 2
  /** It changes only by what a person does, who is answered at once. */
  lasting: boolean
  /** In which it holds, and in no other; null: of no state. */
  mode: Status['mode'] | null
}

/** By the gate, the guard, or the robot's limits. */
export function reason(state: Status | null, reader: Reader): Reason {
  const mode = state?.mode ?? null
  const made = (text: string, weight: Reason['weight'], lasting = false): Reason => ({ text, weight, lasting, mode })
  if (state === null) return made('–', 0, true)
  const repeats = state.why === '' || state.why === state.stopped // which stands beside the button that resets it
  const next = NEXT[state.stopped && repeats ? 'stopped' : state.why]
  if (next !== undefined) return made(next[reader], 2, true)
  if (state.why === DONE) return made(DONE, 0)
  if (state.why !== '') return made(state.why, state.why.startsWith('limited: ') ? 1 : 2)
  const unfiltered = UNFILTERED[state.verdict]
  if (unfiltered !== undefined) return made(unfiltered, 2)
  if (state.nominal === null || state.applied === null) return made('–', 0)
  if (!differ(state.nominal, state.applied)) return made(...asCommanded(state, state.nominal))
  const text = guarded(state)
  if (text === undefined) return made('at its speed or acceleration limit', 0)
  return made(text, state.verdict === 'shaped' ? 1 : 2)
}

/** Where nothing holds it back: why it stands, if it does. */
function asCommanded(state: Status, nominal: Command): [string, Reason['weight']] {
  const stands = !differ(nominal, [0, 0])
  if (stands && state.localised === 'lost' && state.mode === 'automatic') return ['standing: localization is lost', 2]
  if (!stands || !stickAlone(state)) return ['as commanded', 0]
  if (state.localised === 'lost' && state.mode === 'shared') return ['standing: localization is lost; the stick alone steers', 2]
  if (state.arming !== 'armed') return ['standing: no stick is armed', 1]
  const centre = state.stick === null || centred(state.stick)
  return centre ? ['standing: the stick is centred', 0] : ['as commanded', 0]
}

export interface Shown extends Reason {
  /** Until when a lighter one waits [ms]. */
  until: number
}

/** Time to notice a text, and to read it, as subtitles are timed [ms]. */
export function toRead(text: string): number {
  return 500 + 300 * text.split(' ').length
}

/** To hear one, and something else after it [ms]. */
export const TO_HEAR = 5000

/** What is shown now: what weighs more, or most, at once; what does not when the other is over for `lasts` [ms], so that
 * a line that goes to and fro with every step can be read; one of another mode is over at once. */
export function calm(before: Shown | null, next: Reason, now: number, lasts: number): Shown {
  const other = before !== null && next.text !== before.text && next.mode === before.mode
  if (other && now < before.until && next.weight < 2 && next.weight <= before.weight) return before
  return { ...next, until: next.lasting ? now : now + lasts }
}

/** Why the guard changed the command; undefined where no obstacle is close: the robot's own limits did. */
function guarded({ verdict, limiting, clearance_seen }: Status): string | undefined {
  const close = limiting !== null || (clearance_seen !== null && clearance_seen < CLOSE_M)
  return verdict === 'shaped' && !close ? undefined : GUARDED[verdict]
}
