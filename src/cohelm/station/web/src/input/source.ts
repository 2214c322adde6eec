// The reading of a device.

export interface Reading {
  /** False if the device is disconnected; not the same as centred. */
  present: boolean
  /** Fore-aft, forward positive, [-1, 1]. */
  x: number
  /** Left-right, left positive, [-1, 1]. */
  psi: number
  /** Why it is not present, if the device knows. */
  why?: string
}

export type Device = 'none' | 'keyboard' | 'gamepad' | 'touch'

export const DEVICE_NAMES: Record<Device, string> = {
  none: 'no stick', keyboard: 'keyboard', gamepad: 'gamepad', touch: 'touch pads',
}
