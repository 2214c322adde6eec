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

/** The gate's reason without a command. */
const IDLE = 'idle'

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

/** Why the applied command is not the nominal one: by the gate, the guard, or the robot's limits. */
export function why(state: Status | null): string {
  if (state === null) return '–'
  if (state.why === IDLE) return 'idle: choose a mode'
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
