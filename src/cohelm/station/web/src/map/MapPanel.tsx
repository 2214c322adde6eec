// The map: drawing, panning, zooming and waypoint editing.
import { effect, signal } from '@preact/signals'
import { useEffect, useRef } from 'preact/hooks'
import * as s from '../state'
import { within } from '../binary'
import { draw, type Scene } from './draw'
import * as edit from './edit'
import { ghost } from './ghost'
import { points } from './points'
import { trail } from './trail'
import { EditPanel } from './EditPanel'
import { moved, toPixel, toWorld, viewOf, zoomed, type Point, type Size, type View } from './view'

export const follow = signal(true)
const view = signal<View>({ x: 0, y: 0, scale: 45 })
const size: Size = { width: 0, height: 0 }
/** Times of the frames drawn in the last second; the tests read their count. */
const drawn: number[] = []

/** Whether anything has changed since the last frame: painting always would take half a core. */
let dirty = true
let seen: { scans: unknown; points: Float64Array } = { scans: null, points: new Float64Array() }

function scene(now: number): Scene {
  const scans = s.scans.value
  if (seen.scans !== scans) seen = { scans, points: points(scans) }
  const state = s.state.value
  const quality = s.link.value
  const delay = s.stateAge(now) / 1000 + (quality?.round_trip ?? 0) / 2
  return {
    grid: s.grid.value,
    zones: s.zones.value,
    scan: seen.points,
    discs: s.discs.value,
    docks: s.docks.value,
    reference: s.lines.value.reference ?? [],
    detour: s.lines.value.detour ?? [],
    trail: trail.value,
    waypoints: edit.editing.value ? edit.draft.value : (s.lines.value.waypoints ?? []),
    worst: edit.editing.value ? (edit.answer.value?.worst ?? null) : null,
    chosen: edit.chosen.value,
    editing: edit.editing.value,
    state,
    robot: s.robot.value,
    ghost: state !== null && s.linked.value && !s.isReplay.value && delay > 0.03 ? ghost(state, Math.min(delay, 2)) : null,
    lost: state?.localised === 'lost' || s.stateAge(now) > 1000,
  }
}

// on a change of anything the scene reads, and four times a second for ages
effect(() => {
  void [s.clock.value, view.value, follow.value]
  scene(performance.now())
  dirty = true
})

function paint(canvas: HTMLCanvasElement, now: number): void {
  const ctx = canvas.getContext('2d', { alpha: false })
  if (ctx === null || size.width === 0) return
  const ratio = devicePixelRatio
  ctx.setTransform(ratio, 0, 0, ratio, 0, 0)
  const pose = s.state.value?.pose ?? null
  if (follow.value && pose !== null && held.size === 0) {
    view.value = { ...view.value, x: pose[0], y: pose[1] }
  }
  dirty = false
  draw(ctx, view.value, size, scene(now))
  drawn.push(now)
  while ((drawn[0] ?? now) < now - 1000) drawn.shift()
  canvas.dataset.fps = String(drawn.length)
}

const held = new Map<number, Point>()
let dragged: number | null = null
let pressed: { at: Point; moved: boolean } | null = null

function at(event: PointerEvent | WheelEvent): Point {
  return [event.offsetX, event.offsetY]
}

function down(event: PointerEvent): void {
  ;(event.currentTarget as Element).setPointerCapture(event.pointerId)
  held.set(event.pointerId, at(event))
  pressed = { at: at(event), moved: false }
  if (!edit.editing.value) return
  dragged = edit.waypointAt(at(event), edit.draft.value.map((p) => toPixel(view.value, size, p)))
  if (dragged !== null) edit.chosen.value = dragged
}

function move(event: PointerEvent): void {
  const before = held.get(event.pointerId)
  if (before === undefined) return
  const now = at(event)
  if (pressed !== null && Math.hypot(now[0] - pressed.at[0], now[1] - pressed.at[1]) > 4) {
    pressed.moved = true
  }
  if (held.size === 2) pinch(event.pointerId, before, now)
  else if (dragged !== null) edit.move(dragged, toWorld(view.value, size, now))
  else if (pressed?.moved) {
    follow.value = false
    view.value = moved(view.value, now[0] - before[0], now[1] - before[1])
  }
  held.set(event.pointerId, now)
}

function pinch(id: number, before: Point, now: Point): void {
  const other = [...held].find(([key]) => key !== id)?.[1]
  if (other === undefined) return
  const apart = (p: Point) => Math.max(Math.hypot(p[0] - other[0], p[1] - other[1]), 1)
  const middle: Point = [(now[0] + other[0]) / 2, (now[1] + other[1]) / 2]
  view.value = zoomed(view.value, size, middle, apart(now) / apart(before))
}

function up(event: PointerEvent): void {
  const tap = pressed !== null && !pressed.moved && held.size === 1
  if (tap && edit.editing.value && dragged === null && event.type === 'pointerup') {
    edit.add(toWorld(view.value, size, at(event)))
  }
  held.delete(event.pointerId)
  dragged = null
  pressed = null
}

function zoom(factor: number): void {
  view.value = zoomed(view.value, size, [size.width / 2, size.height / 2], factor)
}

function showAll(): void {
  follow.value = false
  const all: Point[] = [...(s.lines.value.reference ?? [])]
  const pose = s.state.value?.pose ?? null
  if (pose !== null) all.push([pose[0], pose[1]])
  view.value = viewOf(all, size) ?? view.value
}

/** A waypoint that was not pointed at: in the middle of the map. */
function addByKey(): void {
  edit.add(toWorld(view.value, size, [size.width / 2, size.height / 2]))
}

export function MapPanel() {
  const ref = useRef<HTMLCanvasElement>(null)
  useEffect(() => {
    const canvas = ref.current
    if (canvas === null) return
    const watch = new ResizeObserver(() => {
      size.width = canvas.clientWidth
      size.height = canvas.clientHeight
      canvas.width = Math.round(size.width * devicePixelRatio)
      canvas.height = Math.round(size.height * devicePixelRatio)
      paint(canvas, performance.now()) // at once: its new size has emptied it
    })
    watch.observe(canvas)
    const wheel = (event: WheelEvent) => {
      event.preventDefault()
      view.value = zoomed(view.value, size, at(event), Math.exp(-event.deltaY / 500))
    }
    canvas.addEventListener('wheel', wheel, { passive: false })
    let frame = 0
    const turn = (now: number) => {
      frame = requestAnimationFrame(turn) // first: a fault in one picture must not be the last one
      if (dirty) paint(canvas, now)
    }
    frame = requestAnimationFrame(turn)
    return () => {
      cancelAnimationFrame(frame)
      watch.disconnect()
      canvas.removeEventListener('wheel', wheel)
    }
  }, [])
  return (
    <section class="map" aria-label="Map">
      <canvas
        ref={ref} id="map" role="img" aria-label={described()}
        class={edit.editing.value ? 'editing' : ''}
        onPointerDown={down} onPointerMove={move} onPointerUp={up} onPointerCancel={up}
      />
      <div class="map-buttons" role="toolbar" aria-label="Map view">
        <button type="button" aria-label="Zoom in" onClick={() => zoom(1.4)}>+</button>
        <button type="button" aria-label="Zoom out" onClick={() => zoom(1 / 1.4)}>−</button>
        <button type="button" aria-pressed={follow.value} onClick={() => (follow.value = !follow.value)}>
          Follow
        </button>
        <button type="button" onClick={showAll}>Show all</button>
        {!s.isReplay.value && (
          <button type="button" aria-expanded={edit.editing.value} disabled={!edit.editing.value && s.state.value === null} onClick={edit.editing.value ? edit.leave : edit.begin}>Edit route</button>
        )}
      </div>
      {edit.editing.value && <EditPanel onAdd={addByKey} />}
    </section>
  )
}

/** Text alternative of the map. */
function described(): string {
  const state = s.state.value
  if (state === null || state.pose === null) return 'Map; no data from the robot yet'
  const [x, y, psi] = state.pose
  const degrees = Math.round((psi * 180) / Math.PI)
  const near = state.clearance_seen
  const clearance = near === null ? '' : `, clearance ${near.toFixed(1)} m`
  const kept = s.zones.value.find((one) => one.what === 'keep_out')
  const zone = kept !== undefined && within(kept, [x, y]) ? ', in a keep-out zone' : ''
  const when = s.linked.value ? '' : ', as it was without a link now'
  return `Map${when}; robot at ${x.toFixed(1)}, ${y.toFixed(1)} metres, heading ${degrees} degrees${zone}${clearance}`
}
