// Two pads for the thumbs, one for each axis; let go, they are centred.
import { signal } from '@preact/signals'
import type { Reading } from './source'

export const touched = signal<{ x: number; psi: number }>({ x: 0, psi: 0 })

export function readTouch(): Reading {
  return { present: navigator.maxTouchPoints > 0 || everTouched, ...touched.value }
}

let everTouched = false

export function touch(part: { x?: number; psi?: number }): void {
  everTouched = true
  touched.value = { ...touched.value, ...part }
}

/** Counts how often all pads were let go of: a finger that was down before does not count after. */
export let grip = 0

/** As if no finger were down. */
export function letGoOfPads(): void {
  grip += 1
  touched.value = { x: 0, psi: 0 }
}
