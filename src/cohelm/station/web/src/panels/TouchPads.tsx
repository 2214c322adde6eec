// Two touch pads: the left one for fore-aft, the right one for left-right.
import { useEffect, useRef } from 'preact/hooks'
import { releasePads, releases, touch, touched } from '../input/touch'
import { clamp } from '../input/stick'
import * as s from '../state'

function Pad({ axis, label }: { axis: 0 | 1; label: string }) {
  const upright = axis === 0
  const value = touched.value[axis]
  const since = useRef(releases)
  const drag = (event: PointerEvent) => {
    const pad = event.currentTarget as HTMLElement
    if (!pad.hasPointerCapture(event.pointerId) || since.current !== releases) return
    const box = pad.getBoundingClientRect()
    const half = (upright ? box.height : box.width) / 2 - 24
    const from = upright ? box.top + box.height / 2 - event.clientY : box.left + box.width / 2 - event.clientX
    touch(axis, clamp(from / half, -1, 1))
  }
  const release = () => touch(axis, 0)
  const shift = upright ? `translateY(${-value * 42}px)` : `translateX(${-value * 42}px)`
  return (
    <div
      class={`pad ${upright ? 'x' : 'psi'}`} role="slider" aria-label={label} aria-valuemin={-100} aria-valuemax={100}
      aria-valuenow={Math.round(value * 100)}
      onPointerDown={(event) => {
        event.currentTarget.setPointerCapture(event.pointerId)
        since.current = releases
        drag(event)
      }}
      onPointerMove={drag} onPointerUp={release} onPointerCancel={release} onLostPointerCapture={release}
    >
      <i style={{ transform: shift }}>{upright ? '▲ ▼' : '◀ ▶'}</i>
    </div>
  )
}

export function TouchPads() {
  const shown = !s.isReplay.value && s.youDrive.value
  useEffect(() => (shown ? releasePads : undefined), [shown]) // hidden pads count as released
  if (!shown) return null
  return (
    <div class="pads">
      <Pad axis={0} label="Forward and back" />
      <Pad axis={1} label="Left and right" />
    </div>
  )
}
