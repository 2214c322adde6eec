// At 50 Hz: selects the device, reads its deflection, arms it, and sends it.
import { computed, effect, signal } from '@preact/signals'
import { keep, kept } from '../kept'
import { newestBeatMs, pauseOrPlay, send, stop } from '../socket'
import * as s from '../state'
import { padResumes, padStops, readPad, resumeButtonName, rumble, takeUp } from './gamepad'
import { due, hint, next, NO_PRESS, pressed } from './resume'
import { settings } from './settings'
import { keysHeld, listenToKeys, readKeys, releaseKeys, takesSpace } from './keyboard'
import type { Command, Do } from '../messages'
import { modeName } from '../panels/format'
import { readTouch, releasePads, touched } from './touch'
import { arm, centred, CENTRED, deflected, needed, sharedSpeed, type Arming, type Device, type Reading } from './stick'

const PERIOD_MS = 20

/** The device that is selected. */
export const device = signal<Device>('none')
/** Share of the full speed; a reload of the page in the middle of a drive must not raise it. */
export const speedScale = signal(sharedSpeed(kept('sessionStorage', 'cohelm.speed')))
effect(() => keep('sessionStorage', 'cohelm.speed', String(speedScale.value)))
/** What is sent. */
export const command = signal<Command>({ stick: CENTRED, valid: false, armed: false, device: 'none', speed_scale: 1 })
/** Why the stick is not armed here, in words; empty when it is. */
const unarmed = signal('no stick in use')

/** Why the stick is not armed; empty: armed here and, if we drive, on the robot. */
export const notArmedReason = computed(() => {
  if (!command.value.armed) return unarmed.value
  if (!s.youDrive.value) return ''
  // only the newest command is used: the robot may have missed the centred one; a centred stick in Auto is not used
  switch (s.state.value?.arming) {
    case 'armed': return ''
    case 'waiting': return 'waiting for your stick to be centred'
    default: return s.state.value?.mode === 'automatic' && !deflected(command.value.stick) ? '' : 'not received by the robot yet'
  }
})

/** Why the stick's present deflection has no effect; empty: it has, or there is none. */
export const noEffectReason = computed(() => {
  const state = s.state.value
  if (state === null || !deflected(command.value.stick)) return ''
  const you_request = s.who.value?.you_request ?? false
  const lease = s.youDrive.value ? '' : s.nobodyDrives.value ? 'press Take over first' : you_request ? 'you have requested control, and wait for it' : 'press Request control first'
  return needed(lease, state.stopped !== '', state.mode)
})

/** How to continue from the gamepad; empty: nothing to continue, or no gamepad in use. */
export const resumeHint = signal('')

let n = 0
let arming: Arming = 'absent'
let drove = false
/** Whether the gamepad was centred since it is there: else nobody's hand deflects it. */
let padRested = false
let press = NO_PRESS
/** The mode the person last drove in. */
let lastMode = ''

export function startDriving(): void {
  listenToKeys()
  addEventListener('keydown', (event) => {
    if (event.code !== 'Space' || takesSpace(event.target)) return
    event.preventDefault()
    if (event.repeat) return
    if (s.isReplay.value) pauseOrPlay()
    else stop()
  })
  // a focused button would take the key's release for a click
  addEventListener('keyup', (event) => {
    if (event.code === 'Space' && !takesSpace(event.target)) event.preventDefault()
  })
  // a browser reports a gamepad when one of its buttons is pressed: the operator wants to use it
  addEventListener('gamepadconnected', ({ gamepad }) => {
    // a spare one that is bumped takes the stick from no hand, also while the station is silent for a moment
    const inHand = s.who.value?.you_drive === true && device.value === 'gamepad' && padRested
    if (inHand || steering(command.value.stick)) return
    takeUp(gamepad.index)
    padRested = false
    choose('gamepad')
  })
  setInterval(() => poll(performance.now()), PERIOD_MS)
  addEventListener('blur', onFocusChange)
  document.addEventListener('visibilitychange', onFocusChange)
}

/** Keys and pads held while the page is inactive count as released, and must be pressed again. */
function onFocusChange(): void {
  if (inactiveReason() !== '') {
    releaseKeys()
    releasePads()
  }
  poll(performance.now())
}

/** Another axis, or another way round, is another stick: it must be centred before it steers. */
const axes = computed(() => {
  const { foreAft, leftRight, foreAftTurned, leftRightTurned } = settings.value
  return [foreAft, leftRight, foreAftTurned, leftRightTurned].join()
})
axes.subscribe(() => {
  if (device.value === 'gamepad') arming = 'absent'
  padRested = false
})

/** Take this device; it must be centred before it steers. */
export function choose(which: Device): void {
  device.value = which
  arming = 'absent'
}

function poll(now: number): void {
  const readings: Record<Device, Reading> = {
    none: 'no stick in use',
    keyboard: readKeys(now),
    gamepad: readPad(now),
    touch: readTouch(),
  }
  if (padStops()) stop()
  pick(readings)
  const reading = readings[device.value]
  const inactive = inactiveReason()
  const drives = s.youDrive.value
  // a new driver starts from the centre, whatever was held before
  if (drives && !drove) arming = 'absent'
  drove = drives
  const used = device.value === 'none' || inactive === '' ? reading : inactive
  arming = arm(arming, used)
  unarmed.value = typeof used === 'string' ? used : arming === 'waiting' ? 'release it to the centre first' : ''
  command.value = {
    stick: typeof used === 'string' ? CENTRED : used, valid: typeof used !== 'string', armed: arming === 'armed',
    device: device.value, speed_scale: speedScale.value,
  }
  send({ type: 'steer', n: ++n, echo_ms: newestBeatMs, command: command.value })
  resumeFromPad(drives, now)
  const leads = drives && device.value === 'gamepad' && deflected(command.value.stick)
  if (leads) rumble(s.state.value?.clearance_seen ?? null, now)
}

/** Each step by a press of its own, as with the mouse: reset, then the mode from before. */
function resumeFromPad(drives: boolean, now: number): void {
  const state = s.state.value
  const { mode, stopped } = state ?? { mode: 'hold', stopped: '' }
  if (!drives) lastMode = ''
  else if (stopped === '' && mode !== 'hold') lastMode = mode
  const held = device.value === 'gamepad' && command.value.armed && centred(command.value.stick)
  const what = held && state !== null ? next(drives, stopped !== '', mode, lastMode) : ''
  const down = padResumes()
  const wanted = due(press, what, down, now)
  press = pressed(press, what, down, now)
  if (wanted !== '') send({ type: 'do', what: wanted as Do['what'], value: 0 })
  resumeHint.value = hint(press, resumeButtonName(), what === 'reset' ? 'resets the stop' : `continues in ${modeName(what)}`)
}

/** Why no stick can be used now; empty: it can. */
function inactiveReason(): string {
  if (document.visibilityState === 'hidden') return 'this tab is hidden'
  if (!document.hasFocus()) return 'this window is not in front'
  if (s.connection.value !== 'open') return 'no connection to the station'
  return ''
}

/** Whether the device in use steers by this reading; one that lies on its side and was not centred does not. */
function steering(reading: Reading): boolean {
  return arming === 'armed' && deflected(reading)
}

/** Select the device that the operator began to use; the present one is kept while it steers. */
function pick(readings: Record<Device, Reading>): void {
  const { gamepad } = readings
  if (typeof gamepad === 'string') padRested = false
  else padRested ||= centred(gamepad)
  if (steering(readings[device.value])) return
  if (keysHeld()) begin('keyboard')
  else if (deflected(touched.value)) begin('touch')
  else if (padRested && deflected(gamepad)) begin('gamepad')
  else if (device.value === 'none') begin(first(readings))
}

/** The default device, before any is used. */
function first(readings: Record<Device, Reading>): Device {
  if (typeof readings.gamepad !== 'string') return 'gamepad'
  return matchMedia('(pointer: coarse)').matches ? 'touch' : 'keyboard'
}

function begin(which: Device): void {
  if (which === device.value) return
  // keys, pads and the dial were centred until they were used: they are armed at once
  arming = which === 'gamepad' ? 'absent' : 'armed'
  device.value = which
}
