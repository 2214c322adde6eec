// Two touch pads for the thumbs, one for each axis; released, they are centred.
import { signal } from '@preact/signals'
import type { Reading } from './stick'

export const touched = signal<{ x: number; psi: number }>({ x: 0, psi: 0 })

export function readTouch(): Reading {
  return { present: navigator.maxTouchPoints > 0 || everTouched, ...touched.value }
}

let everTouched = false

export function touch(part: { x?: number; psi?: number }): void {
  everTouched = true
  touched.value = { ...touched.value, ...part }
}

/** Count of `releasePads`: a finger that was down before does not count afterwards. */
export let releases = 0

/** As if no finger were down. */
export function releasePads(): void {
  releases += 1
  touched.value = { x: 0, psi: 0 }
}
