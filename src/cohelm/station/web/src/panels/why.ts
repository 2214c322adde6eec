// Why the applied command differs from the nominal one.

import type { Status } from '../messages'

/** Nearer than this is close [m]. */
export const CLOSE_M = 0.25

/** The person's share of the command, in [0, 1]; null: nobody commands. In manual mode, and where the
 * localization is lost, there is only the stick, however little it is deflected. */
export function operatorsShare(state: Pick<Status, 'mode' | 'localised' | 'authority'> | null): number | null {
  if (state === null || state.mode === 'hold') return null
  if (state.mode === 'automatic') return 0
  if (state.mode === 'manual' || state.localised === 'lost') return 1
  return 1 - (state.authority ?? 1)
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

const GUARDED: Partial<Record<Status['guarding']['verdict'], string>> = {
  shaped: 'limited: obstacle near',
  braking: 'braking: obstacle near',
  standing: 'standing: no safe motion',
  invalid: 'standing: invalid number (NaN or infinite)',
}

/** Whether the applied command is visibly not the nominal one. */
function other({ nominal, applied }: Status): boolean {
  if (nominal === null || applied === null) return false
  return Math.abs(nominal[0] - applied[0]) > 0.02 || Math.abs(nominal[1] - applied[1]) > 0.05
}

/** Why the applied command is not the nominal one: by the gate, the guard, or the robot's limits; where there is none,
 * what to do. */
export function why(state: Status | null, reader: Reader): string {
  if (state === null) return '–'
  const repeats = state.why === '' || state.why === state.stopped // which stands beside the button that resets it
  const next = NEXT[state.stopped && repeats ? 'stopped' : state.why]
  if (next !== undefined) return next[reader]
  if (state.why !== '') return state.why
  if (!other(state)) return 'as commanded'
  return guarded(state) ?? 'at its speed or acceleration limit'
}

/** Why the guard changed the command; undefined where no obstacle is close: the robot's own limits did. */
function guarded({ guarding: { verdict, limiting, clearance } }: Status): string | undefined {
  const close = limiting !== null || (clearance !== null && clearance < CLOSE_M)
  return verdict === 'shaped' && !close ? undefined : GUARDED[verdict]
}

/** Whether the applied command differs, other than in hold. */
export function abnormal(state: Status | null): boolean {
  if (state === null || (state.mode === 'hold' && state.stopped === '')) return false
  return (state.why !== '' && state.why !== DONE) || (other(state) && guarded(state) !== undefined)
}
