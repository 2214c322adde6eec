// Authority of operator and controller, nominal and applied command, and why they differ.
import { useEffect, useRef } from 'preact/hooks'
import * as colour from '../colours'
import { command, device, notArmedReason } from '../input/drive'
import { DEVICE_NAMES } from '../input/stick'
import { points } from '../map/points'
import { clearances, SECTORS } from '../map/ring'
import * as s from '../state'
import { calm, CLOSE_M, operatorsShare, reason, toRead, TO_HEAR, type Reader, type Shown } from './why'
import { metres, speed, yaw } from './format'

const NEAR_M = 0.7

export function Authority() {
  const state = s.state.value
  const share = operatorsShare(state)
  const clearance = state?.clearance_seen ?? null
  const applied = state?.applied ?? [0, 0]
  const nominal = state?.nominal ?? [0, 0]
  const measured = state?.measured ?? null
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
              <th scope="row">nominal</th><td>{speed(nominal[0])}</td><td>{yaw(nominal[1])}</td>
            </tr>
            <tr title="the command at the wheels">
              <th scope="row">applied</th><td>{speed(applied[0])}</td><td>{yaw(applied[1])}</td>
            </tr>
            <tr class="measured" title="what the robot does, by its odometry">
              <th scope="row">measured</th>
              <td>{measured === null ? '–' : speed(measured[0])}</td>
              <td>{measured === null ? '–' : yaw(measured[1])}</td>
            </tr>
          </tbody>
        </table>
        <Why />
        <p class="nearest">
          clearance <b class={near(clearance)}>{metres(clearance)}</b>
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
  const state = s.state.value
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

function near(clearance: number | null): string {
  return clearance !== null && clearance < CLOSE_M ? 'abnormal' : ''
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

/** The stick's dot inside a ring of clearances by direction. */
function Dial() {
  const ref = useRef<HTMLCanvasElement>(null)
  useEffect(() => {
    const timer = setInterval(() => ref.current && drawDial(ref.current), 66)
    return () => clearInterval(timer)
  }, [])
  return (
    <canvas ref={ref} class="dial" width={320} height={320} role="img"
      aria-label="Stick, and clearance around the robot; forward is up" />
  )
}

function drawDial(canvas: HTMLCanvasElement): void {
  const ctx = canvas.getContext('2d')
  const state = s.state.value
  const robot = s.robot.value
  if (ctx === null) return
  ctx.clearRect(0, 0, 320, 320)
  ctx.translate(160, 160)
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
    // nearer is thicker as well as another colour
    const width = clearance < CLOSE_M ? 34 : clearance < NEAR_M ? 22 : 8
    ctx.beginPath()
    ctx.arc(0, 0, 154 - width / 2, middle - half, middle + half)
    ctx.lineWidth = width
    ctx.strokeStyle = clearance < CLOSE_M ? colour.danger : clearance < NEAR_M ? colour.warning : '#a5aaae'
    ctx.stroke()
  }
  ctx.strokeStyle = '#a5aaae'
  ctx.lineWidth = 2
  ctx.strokeRect(-80, -80, 160, 160)
  ctx.beginPath()
  ctx.moveTo(-80, 0)
  ctx.lineTo(80, 0)
  ctx.moveTo(0, -80)
  ctx.lineTo(0, 80)
  ctx.stroke()
  const [x, psi] = s.isReplay.value ? (state?.stick ?? [0, 0]) : command.value.stick
  ctx.beginPath()
  ctx.arc(-psi * 80, -x * 80, 14, 0, 2 * Math.PI)
  ctx.lineWidth = 5
  ctx.strokeStyle = colour.ink
  ctx.stroke()
  // filled: the deflection that the robot uses
  const used = state?.stick ?? null
  if (used !== null && (s.isReplay.value || s.youDrive.value)) {
    ctx.beginPath()
    ctx.arc(-used[1] * 80, -used[0] * 80, 8, 0, 2 * Math.PI)
    ctx.fillStyle = colour.operator
    ctx.fill()
  }
  ctx.setTransform(1, 0, 0, 1, 0, 0)
}
