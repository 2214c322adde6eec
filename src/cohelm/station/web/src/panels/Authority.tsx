// Authority of operator and controller, nominal and applied command, and why they differ.
import { useEffect, useRef } from 'preact/hooks'
import * as colour from '../colours'
import { command, device, notArmedReason } from '../input/drive'
import { CENTRED, clamp, DEVICE_NAMES } from '../input/stick'
import { releasePads, touch, useGrip } from '../input/touch'
import { points } from '../map/points'
import { clearances, SECTORS } from '../map/ring'
import * as s from '../state'
import { calm, CLOSE_M, operatorsShare, reason, toRead, TO_HEAR, type Reader, type Shown } from './why'
import { metres, speed, yaw } from './format'

const NEAR_M = 0.7

export function Authority() {
  const state = s.present.value
  const share = operatorsShare(state)
  const clearance = state?.clearance_seen ?? null
  const { applied, nominal, measured } = state ?? {}
  return (
    <section class="authority" aria-label="Operator and controller">
      <Dial />
      <div class="facts">
        <div class={`share ${share === null ? 'nobody' : ''}`} role="meter" aria-label="Operator's share of the command"
          aria-valuemin={0} aria-valuemax={100} aria-valuenow={Math.round((share ?? 0) * 100)}
          aria-valuetext={share === null ? 'nobody commands' : undefined}>
          <span class={leads(share !== null && share >= 0.5)}>{s.mayDrive.value ? 'you' : 'driver'}</span>
          <div class="bar"><i style={{ width: `${(share ?? 0) * 100}%` }} /></div>
          <span class={leads(share !== null && share < 0.5)}>auto</span>
        </div>
        <table>
          <tbody>
            <tr class="nominal" title="the operator's command and the controller's, blended, before the safety filter">
              <th scope="row">nominal</th><td>{speed(nominal?.[0])}</td><td>{yaw(nominal?.[1])}</td>
            </tr>
            <tr title="the command at the wheels">
              <th scope="row">applied</th><td>{speed(applied?.[0])}</td><td>{yaw(applied?.[1])}</td>
            </tr>
            <tr class="measured" title="what the robot does, by its odometry">
              <th scope="row">measured</th><td>{speed(measured?.[0])}</td><td>{yaw(measured?.[1])}</td>
            </tr>
          </tbody>
        </table>
        <Why />
        <p class="nearest">
          clearance <b class={nearness(clearance)}>{metres(clearance)}</b>
        </p>
        {!s.isReplay.value && <Stick />}
      </div>
    </section>
  )
}

/** Why the robot does what it does, for the eyes; and, slower, for the ears. */
function Why() {
  void s.clock.value
  const seen = useRef<Shown | null>(null)
  const heard = useRef<Shown | null>(null)
  const state = s.present.value
  const next = reason(state, reader())
  const now = performance.now()
  seen.current = calm(seen.current, next, now, toRead(next.text))
  heard.current = calm(heard.current, next, now, TO_HEAR)
  const odd = seen.current.weight > 0 && !(state?.mode === 'hold' && state.stopped === '')
  return (
    <>
      <p class={`why ${odd ? 'abnormal' : ''}`} aria-hidden="true">{seen.current.text}</p>
      <p class="heard" role="status">{heard.current.text}</p>
    </>
  )
}

function reader(): Reader {
  if (s.isReplay.value || !s.linked.value) return 'nobody'
  return s.youDrive.value ? 'driver' : s.nobodyDrives.value ? 'anyone' : 'other'
}

function leads(is: boolean): string {
  return is ? 'leads' : ''
}

/** How near that is, as number and ring show it; empty: not near, or unknown. */
function nearness(clearance: number | null): '' | 'near' | 'close' {
  if (clearance === null || clearance >= NEAR_M) return ''
  return clearance < CLOSE_M ? 'close' : 'near'
}

/** Nearer is thicker as well as another colour. */
const RING = {
  '': { width: 8, colour: '#a5aaae' }, near: { width: 22, colour: colour.warning }, close: { width: 34, colour: colour.danger },
}

/** What the stick does here and now. */
function steers(): string {
  if (s.connection.value === 'open' && !s.linked.value) return 'no link to the robot'
  if (notArmedReason.value !== '') return notArmedReason.value
  if (!s.youDrive.value) return 'steers once you drive'
  return s.state.value?.mode === 'automatic' ? 'not used in Auto' : 'ready'
}

function Stick() {
  return (
    <p class="device">
      {DEVICE_NAMES[device.value]}: <b>{steers()}</b>
    </p>
  )
}

/** Side of the dial, and a full deflection in it [px]. */
const SIZE = 320
const REACH = 80

/** The stick's dot inside a ring of clearances by direction. */
function Dial() {
  const ref = useRef<HTMLCanvasElement>(null)
  useEffect(() => {
    const timer = setInterval(() => ref.current && drawDial(ref.current), 66)
    return () => { clearInterval(timer); releasePads() }
  }, [])
  // fingers have pads of their own
  const grip = useGrip((event, box) => {
    const half = (box.width * REACH) / SIZE
    const from = (middle: number, at: number) => clamp((middle - at) / half, -1, 1)
    touch([from(box.top + box.height / 2, event.clientY), from(box.left + box.width / 2, event.clientX)])
  }, () => touch(CENTRED), true)
  return (
    <canvas ref={ref} class={`dial ${s.isReplay.value ? '' : 'held'}`} width={SIZE} height={SIZE} role="img"
      title={s.isReplay.value ? undefined : 'Drag the dot with the mouse to steer; it springs back when you let go'}
      aria-label="Stick, and clearance around the robot; forward is up" {...(s.isReplay.value ? {} : grip)} />
  )
}

function drawDial(canvas: HTMLCanvasElement): void {
  const ctx = canvas.getContext('2d')
  const state = s.present.value
  const robot = s.robot.value
  if (ctx === null) return
  ctx.clearRect(0, 0, SIZE, SIZE)
  ctx.translate(SIZE / 2, SIZE / 2)
  const seen = points(s.scans.value)
  const bodies = s.discs.value.map((d): [number, number, number] => [d[0], d[1], d[4]])
  const pose = state?.pose ?? null
  const unknown = state?.clearance_seen == null // then what was seen last may be old
  const all = pose === null || robot === null || unknown
    ? new Array<number>(SECTORS).fill(Infinity)
    : clearances(pose, robot.outline, seen, bodies)
  for (const [i, clearance] of all.entries()) {
    const middle = -Math.PI / 2 - (i * 2 * Math.PI) / SECTORS
    const half = Math.PI / SECTORS - 0.02
    const ring = RING[nearness(clearance)]
    ctx.beginPath()
    ctx.arc(0, 0, 154 - ring.width / 2, middle - half, middle + half)
    ctx.lineWidth = ring.width
    ctx.strokeStyle = ring.colour
    ctx.stroke()
  }
  ctx.strokeStyle = '#a5aaae'
  ctx.lineWidth = 2
  ctx.strokeRect(-REACH, -REACH, 2 * REACH, 2 * REACH)
  ctx.beginPath()
  ctx.moveTo(-REACH, 0)
  ctx.lineTo(REACH, 0)
  ctx.moveTo(0, -REACH)
  ctx.lineTo(0, REACH)
  ctx.stroke()
  const [x, psi] = s.isReplay.value ? (state?.stick ?? [0, 0]) : command.value.stick
  ctx.beginPath()
  ctx.arc(-psi * REACH, -x * REACH, 14, 0, 2 * Math.PI)
  ctx.lineWidth = 5
  ctx.strokeStyle = colour.ink
  ctx.stroke()
  // filled: the deflection that the robot uses, which is none in Auto and Hold
  const led = state !== null && (state.mode === 'shared' || state.mode === 'manual')
  const used = led ? state.stick : null
  if (used !== null && (s.isReplay.value || s.youDrive.value)) {
    ctx.beginPath()
    ctx.arc(-used[1] * REACH, -used[0] * REACH, 8, 0, 2 * Math.PI)
    ctx.fillStyle = colour.operator
    ctx.fill()
  }
  ctx.setTransform(1, 0, 0, 1, 0, 0)
}
