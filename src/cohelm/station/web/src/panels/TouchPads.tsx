// Two touch pads for the thumbs: the left one for fore-aft, the right one for left-right; released, they are centred.
import { signal } from '@preact/signals'
import { useEffect, useRef } from 'preact/hooks'
import { CENTRED, clamp, type Reading, type Stick } from '../input/stick'
import { editing } from '../map/edit'
import * as s from '../state'

export const touched = signal<Stick>(CENTRED)
let everTouched = false
/** Count of `releasePads`: a finger that was down before does not count afterwards. */
let releases = 0

export function readTouch(): Reading {
  return navigator.maxTouchPoints > 0 || everTouched ? touched.value : 'disconnected'
}

/** As if no finger were down. */
export function releasePads(): void {
  releases += 1
  touched.value = CENTRED
}

/** axis: 0 fore-aft, 1 left-right. */
function touch(axis: 0 | 1, deflection: number): void {
  everTouched = true
  const [x, psi] = touched.value
  touched.value = axis === 0 ? [deflection, psi] : [x, deflection]
}

function Pad({ axis, label }: { axis: 0 | 1; label: string }) {
  const upright = axis === 0
  const value = touched.value[axis]
  const since = useRef(releases)
  /** The finger that moves it: the first one. */
  const finger = useRef<number | null>(null)
  const drag = (event: PointerEvent) => {
    const pad = event.currentTarget as HTMLElement
    const { pointerId } = event
    if (pointerId !== finger.current || !pad.hasPointerCapture(pointerId) || since.current !== releases) return
    const box = pad.getBoundingClientRect()
    const half = (upright ? box.height : box.width) / 2 - 24
    const from = upright ? box.top + box.height / 2 - event.clientY : box.left + box.width / 2 - event.clientX
    touch(axis, clamp(from / half, -1, 1))
  }
  const release = (event: PointerEvent) => {
    if (event.pointerId !== finger.current) return
    finger.current = null
    touch(axis, 0)
  }
  const shift = upright ? `translateY(${-value * 42}px)` : `translateX(${-value * 42}px)`
  return (
    <div
      class={`pad ${upright ? 'x' : 'psi'}`} role="slider" aria-label={label} aria-valuemin={-100} aria-valuemax={100}
      aria-valuenow={Math.round(value * 100)}
      onPointerDown={(event) => {
        const first = finger.current
        if (event.button !== 0 || (first !== null && event.currentTarget.hasPointerCapture(first))) return
        event.currentTarget.setPointerCapture(event.pointerId)
        finger.current = event.pointerId
        since.current = releases
        drag(event)
      }}
      onContextMenu={(event) => event.preventDefault()}
      onPointerMove={drag} onPointerUp={release} onPointerCancel={release} onLostPointerCapture={release}
    >
      <i style={{ transform: shift }}>{upright ? '▲ ▼' : '◀ ▶'}</i>
    </div>
  )
}

export function TouchPads() {
  // where they would lie over the route that is edited, or leave it no room; style.css has the same sizes
  const small = '(max-height: 500px) and (min-width: 560px), (max-width: 820px) and (max-height: 800px)'
  const covered = editing.value && matchMedia(small).matches
  const shown = !s.isReplay.value && s.youDrive.value && !covered
  useEffect(() => (shown ? releasePads : undefined), [shown]) // hidden pads count as released
  if (!shown) return null
  return (
    <div class="pads">
      <Pad axis={0} label="Forward and back" />
      <Pad axis={1} label="Left and right" />
    </div>
  )
}
