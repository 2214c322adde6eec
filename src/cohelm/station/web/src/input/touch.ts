// Two touch pads for the thumbs, one for each axis; released, they are centred.
import { signal } from '@preact/signals'
import { CENTRED, type Reading, type Stick } from './stick'

export const touched = signal<Stick>(CENTRED)

export function readTouch(): Reading {
  return navigator.maxTouchPoints > 0 || everTouched ? touched.value : 'disconnected'
}

let everTouched = false

/** axis: 0 fore-aft, 1 left-right. */
export function touch(axis: 0 | 1, deflection: number): void {
  everTouched = true
  const [x, psi] = touched.value
  touched.value = axis === 0 ? [deflection, psi] : [x, deflection]
}

/** Count of `releasePads`: a finger that was down before does not count afterwards. */
export let releases = 0

/** As if no finger were down. */
export function releasePads(): void {
  releases += 1
  touched.value = CENTRED
}
