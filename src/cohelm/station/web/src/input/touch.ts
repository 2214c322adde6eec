// The stick under a finger or a mouse: on the two pads, or dragged in the dial; released, it is centred.
import { signal } from '@preact/signals'
import { useRef } from 'preact/hooks'
import { CENTRED, type Reading, type Stick } from './stick'

export const touched = signal<Stick>(CENTRED)
let everTouched = false
/** Count of `releasePads`: a pointer that was down before does not count afterwards. */
let releases = 0

export function readTouch(): Reading {
  return navigator.maxTouchPoints > 0 || everTouched ? touched.value : 'disconnected'
}

/** As if no finger and no button were down. */
export function releasePads(): void {
  releases += 1
  touched.value = CENTRED
}

export function touch(stick: Stick): void {
  everTouched = true
  touched.value = stick
}

/** Handlers of what one pointer holds at a time, the first: where it is over the box, and that it let go. */
export function useGrip(moved: (event: PointerEvent, box: DOMRect) => void, released: () => void, mouseOnly = false) {
  const since = useRef(releases)
  const pointer = useRef<number | null>(null)
  const drag = (event: PointerEvent) => {
    const held = event.currentTarget as HTMLElement
    if (event.pointerId !== pointer.current || !held.hasPointerCapture(event.pointerId) || since.current !== releases) return
    moved(event, held.getBoundingClientRect())
  }
  const release = (event: PointerEvent) => {
    if (event.pointerId !== pointer.current) return
    pointer.current = null
    released()
  }
  return {
    onPointerDown: (event: PointerEvent) => {
      const held = event.currentTarget as HTMLElement
      const first = pointer.current
      if (event.button !== 0 || (mouseOnly && event.pointerType === 'touch') || (first !== null && held.hasPointerCapture(first))) return
      held.setPointerCapture(event.pointerId)
      pointer.current = event.pointerId
      since.current = releases
      drag(event)
    },
    onContextMenu: (event: Event) => event.preventDefault(),
    onPointerMove: drag, onPointerUp: release, onPointerCancel: release, onLostPointerCapture: release,
  }
}
