// The newest picture, its age, and the predicted path drawn into it.
import { useEffect, useRef } from 'preact/hooks'
import * as colour from '../colours'
import { toBody, type Point } from '../map/view'
import { send } from '../socket'
import * as s from '../state'
import { project, type Lens } from './project'
import { ago } from './format'

const OLD_MS = 500

export function Camera() {
  const ref = useRef<HTMLCanvasElement>(null)
  useEffect(() => s.frame.subscribe((frame) => {
    if (frame !== null) void show(ref.current)
  }), [])
  void s.clock.value
  const frame = s.frame.value
  if (s.robot.value?.camera == null && frame === null) {
    const none = s.robot.value === null ? 'No picture yet.' : 'This robot has no camera.'
    return <section class="camera none" aria-label="Camera"><p>{none}</p></section>
  }
  const age = frame === null ? null : frame.ageMs + performance.now() - frame.at
  const old = age === null || age > OLD_MS
  return (
    <section class="camera" aria-label="Camera">
      <canvas ref={ref} id="camera" width={640} height={480} role="img" aria-label="Picture of the robot's camera" />
      {!s.isReplay.value && (
        <span class={`age ${old ? 'abnormal' : ''}`}>{frame === null ? 'no picture yet' : `${ago(age)} old`}</span>
      )}
    </section>
  )
}

let busy = false
/** Whether another picture came while one was drawn; no more than two are on their way. */
let waiting = false

/** Draw the newest picture, and acknowledge it, also where there is no place to draw it. */
async function show(canvas: HTMLCanvasElement | null): Promise<void> {
  const frame = s.frame.value
  if (busy) {
    waiting = true
    return
  }
  if (canvas === null || frame === null) {
    send({ type: 'got', stream: 'frame' })
    return
  }
  busy = true
  try {
    const picture = await createImageBitmap(new Blob([frame.jpeg], { type: 'image/jpeg' }))
    if (canvas.width !== picture.width || canvas.height !== picture.height) {
      canvas.width = picture.width
      canvas.height = picture.height
    }
    const ctx = canvas.getContext('2d', { alpha: false })
    if (ctx !== null) {
      ctx.drawImage(picture, 0, 0)
      const lens = s.robot.value?.camera
      if (lens != null) drawPredictedPath(ctx, canvas, lens, frame.pose)
      canvas.dataset.number = String(frame.number)
      canvas.dataset.ageMs = String(Math.round(frame.ageMs + performance.now() - frame.at))
    }
    picture.close()
  } catch (error) {
    console.error('picture', error)
  } finally {
    busy = false
    send({ type: 'got', stream: 'frame' })
    if (waiting) {
      waiting = false
      void show(canvas)
    }
  }
}

/** Both edges of the predicted path on the floor. */
function drawPredictedPath(
  ctx: CanvasRenderingContext2D, size: { width: number; height: number }, lens: Lens,
  pose: [number, number, number],
): void {
  const state = s.state.value
  const outline = s.robot.value?.outline ?? []
  if (state === null || state.ahead.length < 2) return
  const half = Math.max(...outline.map((c) => Math.abs(c[1])))
  ctx.lineWidth = Math.max(2, size.width / 200)
  ctx.strokeStyle = colour.operator
  for (const side of [-half, half]) {
    ctx.beginPath()
    let drawing = false
    for (const point of offset(state.ahead, side)) {
      const at = project(lens, size, toBody(pose, point))
      if (at === null) continue
      if (drawing) ctx.lineTo(at[0], at[1])
      else ctx.moveTo(at[0], at[1])
      drawing = true
    }
    ctx.stroke()
  }
}

/** The path moved sideways by `d`. */
function offset(path: Point[], d: number): Point[] {
  return path.map((p, i) => {
    const a = path[Math.max(i - 1, 0)] ?? p
    const b = path[Math.min(i + 1, path.length - 1)] ?? p
    const long = Math.hypot(b[0] - a[0], b[1] - a[1]) || 1
    return [p[0] - (d * (b[1] - a[1])) / long, p[1] + (d * (b[0] - a[0])) / long]
  })
}
