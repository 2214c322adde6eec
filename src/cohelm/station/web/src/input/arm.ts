// Whether a stick is believed: it must have been centred since it came before it steers.
// The robot keeps the same rule on its side, and says up to where that is; this one is for the person to see at once.

export type Arming = 'absent' | 'waiting' | 'armed'

/** Next state from whether the device is there, and where it is. centre: up to this it is centred. */
export function arm(before: Arming, present: boolean, x: number, psi: number, centre: number): Arming {
  if (!present || !Number.isFinite(x) || !Number.isFinite(psi)) return 'absent'
  if (before === 'armed') return 'armed'
  return centred(x, psi, centre) ? 'armed' : 'waiting'
}

export function centred(x: number, psi: number, centre: number): boolean {
  return Math.abs(x) <= centre && Math.abs(psi) <= centre
}

/** What a person has to do first for a deflected stick to steer; empty: nothing. */
export function needed(drives: boolean, stopped: boolean, mode: string): string {
  if (!drives) return 'press Take over first'
  if (stopped) return 'press Let it drive first'
  if (mode === 'hold') return 'the robot holds; choose Shared or Manual'
  if (mode === 'automatic') return 'the controller drives alone; choose Shared or Manual'
  return ''
}
