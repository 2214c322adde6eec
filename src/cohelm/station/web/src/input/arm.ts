// Arms the stick: it must have been centred since it was connected before it steers.
// The robot has the same rule and sends its threshold; this copy shows the operator the result at once.

export type Arming = 'absent' | 'waiting' | 'armed'

/** The next state, from the device's presence and deflection. centre: threshold of a centred stick. */
export function arm(before: Arming, present: boolean, x: number, psi: number, centre: number): Arming {
  if (!present || !Number.isFinite(x) || !Number.isFinite(psi)) return 'absent'
  if (before === 'armed') return 'armed'
  return centred(x, psi, centre) ? 'armed' : 'waiting'
}

export function centred(x: number, psi: number, centre: number): boolean {
  return Math.abs(x) <= centre && Math.abs(psi) <= centre
}

/** What the operator must do first for a deflected stick to steer; empty: nothing. */
export function needed(drives: boolean, stopped: boolean, mode: string): string {
  if (!drives) return 'press Take over first'
  if (stopped) return 'press Reset first'
  if (mode === 'hold') return 'mode is Hold; choose Shared or Manual'
  if (mode === 'automatic') return 'mode is Auto; choose Shared or Manual'
  return ''
}
