// What every device says when asked.

export interface Reading {
  /** False where the device is gone; not the same as centred. */
  present: boolean
  /** Fore-aft, forward positive, [-1, 1]. */
  x: number
  /** Left-right, left positive, [-1, 1]. */
  psi: number
  /** Why it is not present, where the device itself knows. */
  why?: string
}

export type Device = 'none' | 'keyboard' | 'gamepad' | 'touch'

export const DEVICE_NAMES: Record<Device, string> = {
  none: 'no stick', keyboard: 'keyboard', gamepad: 'gamepad', touch: 'touch pads',
}
