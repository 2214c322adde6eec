// The one WebSocket to the station: opens it again when it is lost, and knows when it is silent.
import { batch } from '@preact/signals'
import { decode, painted, zoned, type MapPart, type ZonePart } from './binary'
import type { Do, FromPage, ToPage } from './messages'
import { ask, onEntered, session } from './session'
import * as s from './state'

const KEY = 'cohelm.key'
const FIRST_WAIT_MS = 250
const LONGEST_WAIT_MS = 2000
/** A socket that has been silent for so long is given up, if that is much for this station; a new
 * one may find a way. */
const GIVE_UP_MS = 1500
/** More waiting to be sent than this means that nothing gets through: say no more. */
const FULL = 8192

let socket: WebSocket | null = null
let lastHeard = 0
let wait = FIRST_WAIT_MS
let parts: Promise<unknown> = Promise.resolve()

/** `at_ms` of the newest beat. */
export let heardMs = 0

/** What a panel sends; what is to be done once is stamped here. */
type Said = Exclude<FromPage, Do> | Omit<Do, 'heard_ms'>

export function send(message: Said): boolean {
  if (socket?.readyState !== WebSocket.OPEN || socket.bufferedAmount > FULL) return false
  // what is to be done once says when it was asked for, by the station's clock
  socket.send(JSON.stringify(message.type === 'do' ? { ...message, heard_ms: heardMs } : message))
  return true
}

export function start(): void {
  void again()
  onEntered(() => {
    if (s.connection.value === 'login') void retry()
  })
  setInterval(watch, 50)
  setInterval(() => (s.clock.value += 1), 250)
}

function watch(): void {
  if (socket?.readyState !== WebSocket.OPEN) return
  const silent = performance.now() - lastHeard
  const stale = (s.welcome.value?.stale_s ?? 0.25) * 1000
  if (silent > Math.max(GIVE_UP_MS, 2 * stale)) {
    lost(socket)
  } else if (silent > stale) {
    if (s.connection.value === 'open') s.connection.value = 'silent'
  } else if (s.connection.value === 'silent') {
    s.connection.value = 'open'
  }
}

async function connect(): Promise<void> {
  const url = new URL('./ws', location.href)
  url.protocol = location.protocol === 'https:' ? 'wss:' : 'ws:'
  url.hash = ''
  const key = kept()
  if (key !== null) url.searchParams.set('key', key)
  const opened = new WebSocket(url, ['cohelm', session() ?? 'none'])
  socket = opened
  opened.binaryType = 'arraybuffer'
  opened.onopen = () => {
    if (opened === socket) lastHeard = performance.now() // it is silent from now on, not before
  }
  opened.onmessage = (event: MessageEvent<string | ArrayBuffer>) => {
    if (opened === socket) heard(event.data)
  }
  opened.onclose = () => lost(opened)
}

function lost(of: WebSocket): void {
  if (of !== socket) return
  of.onclose = null
  of.close()
  socket = null
  s.connection.value = 'closed'
  setTimeout(() => void again(), wait)
  wait = Math.min(wait * 2, LONGEST_WAIT_MS)
}

async function again(): Promise<void> {
  try {
    // a refused WebSocket does not say why; this does
    const answer = await ask('./session')
    if (answer.status === 401) {
      s.connection.value = 'login'
      return
    }
  } catch {
    // not there at all: try again below
  }
  s.connection.value = 'connecting'
  await connect()
}

/** Try once more, now: after a login. */
export async function retry(): Promise<void> {
  wait = FIRST_WAIT_MS
  await again()
}

function kept(): string | null {
  try {
    return sessionStorage.getItem(KEY)
  } catch {
    return null
  }
}

function heard(data: string | ArrayBuffer): void {
  lastHeard = performance.now()
  if (typeof data !== 'string') {
    bytes(data)
    return
  }
  const message = JSON.parse(data) as ToPage
  batch(() => take(message))
}

function bytes(data: ArrayBuffer): void {
  const got = decode(data, performance.now())
  if (got === null) return
  if ('zones' in got) {
    parts = parts.then(() => zone(got.zones)).catch((error) => console.error('zones', error))
  } else if ('map' in got) {
    parts = parts.then(() => paint(got.map)).catch((error) => console.error('map', error))
  } else if ('scan' in got) {
    const { lidar } = got.scan
    s.scans.value = [...s.scans.value.filter((one) => one.lidar !== lidar), got.scan]
    send({ type: 'got', stream: 'scan' })
  } else {
    s.frame.value = got.frame // credited when it has been drawn
  }
}

async function zone(part: ZonePart): Promise<void> {
  const made = part.columns * part.rows > 0 ? [await zoned(part)] : []
  s.zones.value = [...s.zones.value.filter((one) => one.what !== part.what), ...made]
}

async function paint(part: MapPart): Promise<void> {
  s.grid.value = await painted(s.grid.value, part)
}

function refuse(text: string): void {
  s.refused.value = { text, at: performance.now() }
}

function take(message: ToPage): void {
  switch (message.type) {
    case 'beat':
      heardMs = message.at_ms
      s.pageMs.value = message.page_ms
      break
    case 'welcome':
      s.welcome.value = message
      s.connection.value = 'open'
      wait = FIRST_WAIT_MS
      try {
        sessionStorage.setItem(KEY, message.key)
      } catch {
        // a browser that keeps nothing: a reload makes a new operator
      }
      break
    case 'robot':
      s.robot.value = message
      break
    case 'state':
      s.state.value = message
      s.stateAt.value = performance.now()
      send({ type: 'got', stream: 'state' })
      break
    case 'who':
      s.who.value = message
      break
    case 'alarms':
      s.alarms.value = message.alarms
      break
    case 'discs':
      s.discs.value = message.rows
      break
    case 'line':
      s.lines.value = { ...s.lines.value, [message.what]: message.points }
      break
    case 'docks':
      s.docks.value = message.docks
      break
    case 'link':
      s.link.value = message
      break
    case 'records':
      s.records.value = message.files
      break
    case 'playing':
      s.playing.value = message
      break
    case 'checked':
      s.checked.value = message
      if (!message.ok && !message.only_check) refuse(`route: ${message.why}`)
      break
    case 'refused':
      refuse(`${message.what}: ${message.why}`)
      break
  }
}
