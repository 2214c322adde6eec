// Formats numbers and modes for display.
import type { Status } from '../messages'

/** A battery with less of its charge is low, and with less of it soon empty. */
export const LOW_BATTERY = 0.2
export const EMPTY_BATTERY = 0.1

/** Mode, its name, and what it means. */
export const MODES: Array<[Status['mode'], string, string]> = [
  ['hold', 'Hold', 'stand still'],
  ['shared', 'Shared', 'the controller follows the route; you take over as far as you deflect the stick'],
  ['automatic', 'Auto', 'the controller alone'],
  ['manual', 'Manual', 'the stick alone; obstacles are still avoided'],
]

export function modeName(mode: string): string {
  return MODES.find(([name]) => name === mode)?.[1] ?? mode
}

const BUTTONS: { [what: string]: string } = {
  stop: 'STOP', take: 'Take over', give: 'Release', refuse: 'Keep', record_stop: 'Stop recording',
}

/** A request as its button is called. */
export function buttonName(what: string): string {
  const mode = modeName(what)
  return BUTTONS[what] ?? (mode !== what ? mode : what.charAt(0).toUpperCase() + what.slice(1))
}

/** Quality of localization; its standard deviation [m] only where the pose is estimated. */
export function localization({ localised, sigma }: Pick<Status, 'localised' | 'sigma'>): string {
  if (localised === 'unknown') return 'no map, odometry only'
  const estimated = localised === 'good' || localised === 'poor'
  return sigma === null || !estimated ? localised : `${localised}, ± ${(sigma * 100).toFixed(0)} cm`
}

export function metres(value: number | null | undefined): string {
  return value == null ? '–' : `${tidy(value)} m`
}

export function speed(value: number | null | undefined): string {
  return value == null ? '–' : `${tidy(value)} m/s`
}

export function yaw(value: number | null | undefined): string {
  return value == null ? '–' : `${tidy(value)} rad/s`
}

/** Two decimals, without a negative zero. */
export function tidy(value: number): string {
  const text = value.toFixed(2)
  return text === '-0.00' ? '0.00' : text.replace('-', '−')
}

export function ms(value: number | null | undefined): string {
  return value == null || !Number.isFinite(value) ? '–' : `${Math.round(value)} ms`
}

/** How long ago, as a person says it. */
export function ago(milliseconds: number | null | undefined): string {
  if (milliseconds == null || !Number.isFinite(milliseconds)) return '–'
  if (milliseconds < 1000) return ms(milliseconds)
  if (milliseconds < 100_000) return `${Math.round(milliseconds / 1000)} s`
  const whole = Math.round(milliseconds / 60_000)
  return whole < 100 ? `${whole} min` : `${Math.round(whole / 60)} h`
}

export function percent(value: number | null | undefined): string {
  return value == null ? '–' : `${(value * 100).toFixed(value < 0.1 ? 1 : 0)} %`
}

export function bytes(value: number): string {
  return value < 1e6 ? `${(value / 1e3).toFixed(0)} kB` : `${(value / 1e6).toFixed(1)} MB`
}

export function minutes(seconds: number): string {
  const whole = Math.max(0, Math.floor(seconds))
  const rest = String(whole % 60).padStart(2, '0')
  return `${Math.floor(whole / 60)}:${rest}`
}
