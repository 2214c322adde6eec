// Two touch pads for the thumbs: the left one for fore-aft, the right one for left-right; released, they are centred.
import { useEffect } from 'preact/hooks'
import { clamp } from '../input/stick'
import { releasePads, touch, touched, useGrip } from '../input/touch'
import { editing } from '../map/edit'
import * as s from '../state'

function Pad({ axis, label }: { axis: 0 | 1; label: string }) {
  const upright = axis === 0
  const value = touched.value[axis]
  const set = (deflection: number) => {
    const [x, psi] = touched.value
    touch(upright ? [deflection, psi] : [x, deflection])
  }
  const grip = useGrip((event, box) => {
    const half = (upright ? box.height : box.width) / 2 - 24
    const from = upright ? box.top + box.height / 2 - event.clientY : box.left + box.width / 2 - event.clientX
    set(clamp(from / half, -1, 1))
  }, () => set(0))
  const shift = upright ? `translateY(${-value * 42}px)` : `translateX(${-value * 42}px)`
  return (
    <div
      class={`pad ${upright ? 'x' : 'psi'}`} role="slider" aria-label={label} aria-valuemin={-100} aria-valuemax={100}
      aria-valuenow={Math.round(value * 100)} {...grip}
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
