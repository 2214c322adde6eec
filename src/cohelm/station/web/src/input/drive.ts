// Fifty times a second: which stick is in hand, where it is, and whether it is to be believed.
import { computed, signal } from '@preact/signals'
import { heardMs, send } from '../socket'
import * as s from '../state'
import { arm, centred, needed, type Arming } from './arm'
import { goOnName, padGoesOn, padStops, readPad, rumble } from './gamepad'
import { due, hint, next, NO_PRESS, pressed } from './goOn'
import { keysHeld, letGoOfKeys, listenToKeys, readKeys, typing } from './keyboard'
import type { Do } from '../messages'
import { modeName } from '../panels/words'
import type { Device, Reading } from './source'
import { letGoOfPads, readTouch, touched } from './touch'

const PERIOD_MS = 20
const IN_USE = 0.1

export interface Hand extends Reading {
  device: Device
  arming: Arming
  /** Why it is not armed, in words; empty when it is. */
  why: string
}

export const hand = signal<Hand>({
  device: 'none', present: false, x: 0, psi: 0, arming: 'absent', why: 'no stick in use',
})
export const speedScale = signal(1)

/** Why what the hand does would not steer, or empty: both this page and the robot saw it centred. */
export const idle = computed(() => {
  const { arming, why } = hand.value
  if (arming !== 'armed') return why
  if (!s.youDrive.value) return ''
  // the newest wins on the way: the robot need not have heard the moment in the centre
  switch (s.state.value?.arming) {
    case 'armed': return ''
    case 'waiting': return 'waiting for your stick to be centred'
    default: return 'the robot does not hear it yet'
  }
})

/** Why a stick that is deflected now comes to nothing, whoever drives; empty: it does not. */
export const useless = computed(() => {
  const state = s.state.value
  if (state === null || !hand.value.present || !deflected(hand.value)) return ''
  return needed(s.youDrive.value, state.stopped !== '', state.mode)
})

/** How to drive on from the gamepad; empty: there is nothing to go on from, or no gamepad in hand. */
export const goOn = signal('')

let n = 0
let device: Device = 'none'
let arming: Arming = 'absent'
let drove = false
let press = NO_PRESS
/** The mode the person last drove in. */
let lastMode = ''

export function startDriving(): void {
  listenToKeys()
  addEventListener('keydown', (event) => {
    if (event.code !== 'Space' || typing(event.target)) return
    event.preventDefault()
    if (!event.repeat) stop()
  })
  // a focused button would take the key's release for a click
  addEventListener('keyup', (event) => {
    if (event.code === 'Space' && !typing(event.target)) event.preventDefault()
  })
  // a browser shows a pad when a button of it is pressed: somebody wants to use it
  addEventListener('gamepadconnected', () => {
    if (hand.value.present && deflected(hand.value)) return
    choose('gamepad')
  })
  setInterval(() => turn(performance.now()), PERIOD_MS)
  addEventListener('blur', away)
  document.addEventListener('visibilitychange', away)
}

/** What is held while nobody can see the page is let go, and must be taken in hand again. */
function away(): void {
  if (elsewhere() !== '') {
    letGoOfKeys()
    letGoOfPads()
  }
  turn(performance.now())
}

export function stop(): void {
  send({ type: 'do', what: 'stop', value: 0 })
}

/** Take this device; it must be centred before it steers. */
export function choose(which: Device): void {
  device = which
  arming = 'absent'
}

function turn(now: number): void {
  const readings: Record<Device, Reading> = {
    none: { present: false, x: 0, psi: 0 },
    keyboard: readKeys(now),
    gamepad: readPad(now),
    touch: readTouch(),
  }
  if (padStops()) stop()
  pick(readings)
  const reading = readings[device]
  const away = elsewhere()
  const drives = s.youDrive.value
  // a new driver starts from the centre, whatever was held before
  if (drives && !drove) arming = 'absent'
  drove = drives
  const present = reading.present && away === ''
  arming = arm(arming, present, reading.x, reading.psi, centre())
  const why = device === 'none' ? 'no stick in use' : away || reason(reading)
  hand.value = { ...reading, present, device, arming, why }
  send({
    type: 'stick', n: ++n, heard_ms: heardMs, x: present ? reading.x : 0,
    psi: present ? reading.psi : 0, valid: present, armed: arming === 'armed',
    device, speed_scale: speedScale.value,
  })
  goOnFromPad(drives, now)
  const leads = drives && device === 'gamepad' && deflected(hand.value)
  if (leads) rumble(s.state.value?.clearance_m ?? null, now)
}

/** Each step by a press of its own, as with the mouse: let it drive, and then on in the mode of before. */
function goOnFromPad(drives: boolean, now: number): void {
  const state = s.state.value
  const { mode, stopped } = state ?? { mode: 'hold', stopped: '' }
  if (!drives) lastMode = ''
  else if (stopped === '' && mode !== 'hold') lastMode = mode
  const held = hand.value.device === 'gamepad' && hand.value.arming === 'armed' && centred(hand.value.x, hand.value.psi, centre())
  const what = held && state !== null ? next(drives, stopped !== '', mode, lastMode) : ''
  const down = padGoesOn()
  const wanted = due(press, what, down, now)
  press = pressed(press, what, down, now)
  if (wanted !== '') send({ type: 'do', what: wanted as Do['what'], value: 0 })
  goOn.value = hint(press, goOnName(), what === 'reset' ? 'it may drive' : `on in ${modeName(what)}`)
}

function reason(reading: Reading): string {
  if (!reading.present) return reading.why || (device === 'gamepad' ? 'the gamepad is gone' : 'gone')
  return arming === 'waiting' ? 'let it go to the centre first' : ''
}

/** Up to where a stick is centred, as the robot has it; without a station none steers. */
function centre(): number {
  return s.welcome.value?.centre ?? 0
}

/** Why no stick counts just now, or empty. */
function elsewhere(): string {
  if (document.visibilityState === 'hidden') return 'this tab is hidden'
  if (!document.hasFocus()) return 'this window is not in front'
  if (s.connection.value !== 'open') return 'no connection to the station'
  return ''
}

/** The device that a person just began to use; the present one as long as it is deflected. */
function pick(readings: Record<Device, Reading>): void {
  const now = readings[device]
  if (now.present && deflected(now)) return
  if (keysHeld()) begin('keyboard')
  else if (deflected(touched.value)) begin('touch')
  else if (readings.gamepad.present && deflected(readings.gamepad)) begin('gamepad')
  else if (device === 'none') begin(first(readings))
}

/** Before anything was touched: what is most likely meant. */
function first(readings: Record<Device, Reading>): Device {
  if (readings.gamepad.present) return 'gamepad'
  return matchMedia('(pointer: coarse)').matches ? 'touch' : 'keyboard'
}

function begin(which: Device): void {
  if (which === device) return
  // keys and pads rest in the centre until they are used: they are armed by that
  arming = which === 'gamepad' ? 'absent' : 'armed'
  device = which
}

function deflected(reading: { x: number; psi: number }): boolean {
  return Math.abs(reading.x) > IN_USE || Math.abs(reading.psi) > IN_USE
}
