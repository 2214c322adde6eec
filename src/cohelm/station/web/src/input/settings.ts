// The operator's stick settings, stored by the browser.
import { signal } from '@preact/signals'
import { keep, kept } from '../kept'
import { clamp } from './stick'

export interface Settings {
  /** Axis numbers of the gamepad, and whether they are inverted. */
  foreAft: number
  leftRight: number
  foreAftTurned: boolean
  leftRightTurned: boolean
  deadBand: number
  curve: number
  rumble: boolean
  /** Seconds from centre to full deflection on the keyboard. */
  ramp: number
  /** Stop button of the gamepad. */
  stopButton: number
  /** Resume button of the gamepad; none if it is the stop button. */
  goOnButton: number
}

// On a standard pad forward is −1 and left is −1; ours are both +1.
export const DEFAULTS: Settings = {
  foreAft: 1, leftRight: 0, foreAftTurned: true, leftRightTurned: true,
  deadBand: 0.08, curve: 0.3, rumble: true, ramp: 0.4, stopButton: 1, goOnButton: 0,
}

const KEY = 'cohelm.stick'

/** The stored settings, with the default for each that is not valid. */
export function sound(kept: unknown): Settings {
  if (typeof kept !== 'object' || kept === null) return DEFAULTS
  const k = kept as Record<string, unknown>
  const number = (name: keyof Settings, low: number, high: number): number => {
    const value = k[name]
    return typeof value === 'number' && Number.isFinite(value)
      ? clamp(value, low, high)
      : (DEFAULTS[name] as number)
  }
  const yes = (name: keyof Settings): boolean =>
    typeof k[name] === 'boolean' ? (k[name] as boolean) : (DEFAULTS[name] as boolean)
  return {
    foreAft: Math.round(number('foreAft', 0, 15)),
    leftRight: Math.round(number('leftRight', 0, 15)),
    foreAftTurned: yes('foreAftTurned'),
    leftRightTurned: yes('leftRightTurned'),
    deadBand: number('deadBand', 0, 0.5),
    curve: number('curve', 0, 1),
    rumble: yes('rumble'),
    ramp: number('ramp', 0.05, 3),
    stopButton: Math.round(number('stopButton', 0, 31)),
    goOnButton: Math.round(number('goOnButton', 0, 31)),
  }
}

function load(): Settings {
  try {
    return sound(JSON.parse(kept('localStorage', KEY) ?? 'null'))
  } catch {
    return DEFAULTS
  }
}

export const settings = signal<Settings>(load())

export function change(part: Partial<Settings>): void {
  settings.value = sound({ ...settings.value, ...part })
  keep('localStorage', KEY, JSON.stringify(settings.value))
}
