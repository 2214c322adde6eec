// The WebSocket to the station: reconnects it when it is lost, and detects silence.
import { batch } from '@preact/signals'
import { decode, painted, zoned, type MapPart, type ZonePart } from './binary'
import type { Do, FromPage, ToPage } from './messages'
import { authorizedFetch, onLogIn, session } from './session'
import * as s from './state'

const KEY = 'cohelm.key'
const FIRST_WAIT_MS = 250
const LONGEST_WAIT_MS = 2000
/** A socket that is silent for so long is replaced, or after twice the station's limit if longer. */
const GIVE_UP_MS = 1500
/** With more bytes waiting to be sent, nothing gets through: send no more. */
const FULL = 8192
/** Close code of a station that does not accept what this page sends. */
const REFUSED = 1008

let socket: WebSocket | null = null
let lastReceived = 0
let wait = FIRST_WAIT_MS
let parts: Promise<unknown> = Promise.resolve()

/** `at_ms` of the newest beat. */
export let newestBeatMs = 0

/** A message from a panel; requests are stamped here. */
type Outgoing = Exclude<FromPage, Do> | Omit<Do, 'echo_ms'>

export function send(message: Outgoing): boolean {
  if (socket?.readyState !== WebSocket.OPEN || socket.bufferedAmount > FULL) return false
  // a request carries the time it was made, by the station's clock
  socket.send(JSON.stringify(message.type === 'do' ? { ...message, echo_ms: newestBeatMs } : message))
  return true
}

export function start(): void {
  void reconnect()
  onLogIn(() => {
    if (s.connection.value === 'login') void retry()
  })
  setInterval(watch, 50)
  setInterval(() => (s.clock.value += 1), 250)
}

function watch(): void {
  if (socket?.readyState !== WebSocket.OPEN) return
  const silent = performance.now() - lastReceived
  const stale = (s.welcome.value?.stale_s ?? 0.25) * 1000
  if (silent > Math.max(GIVE_UP_MS, 2 * stale)) {
    dropSocket(socket)
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
  const key = storedKey()
  if (key !== null) url.searchParams.set('key', key)
  const opened = new WebSocket(url, ['cohelm', session() ?? 'none'])
  socket = opened
  opened.binaryType = 'arraybuffer'
  opened.onopen = () => {
    if (opened === socket) lastReceived = performance.now() // silence counts from now on
  }
  opened.onmessage = (event: MessageEvent<string | ArrayBuffer>) => {
    if (opened === socket) receive(event.data)
  }
  opened.onclose = ({ code, reason }) => {
    if (opened === socket && code === REFUSED && reason !== '') refuse(reason)
    dropSocket(opened)
  }
}

function dropSocket(of: WebSocket): void {
  if (of !== socket) return
  of.onclose = null
  of.close()
  socket = null
  s.connection.value = 'closed'
  setTimeout(() => void reconnect(), wait)
  wait = Math.min(wait * 2, LONGEST_WAIT_MS)
}

async function reconnect(): Promise<void> {
  try {
    // a refused WebSocket gives no reason; this request does
    const answer = await authorizedFetch('./session')
    if (answer.status === 401) {
      s.connection.value = 'login'
      return
    }
  } catch {
    // the station is not there: try again below
  }
  s.connection.value = 'connecting'
  await connect()
}

/** Try again at once, after a login. */
export async function retry(): Promise<void> {
  wait = FIRST_WAIT_MS
  await reconnect()
}

function storedKey(): string | null {
  try {
    return sessionStorage.getItem(KEY)
  } catch {
    return null
  }
}

function receive(data: string | ArrayBuffer): void {
  lastReceived = performance.now()
  if (typeof data !== 'string') {
    bytes(data)
    return
  }
  const message = JSON.parse(data) as ToPage
  batch(() => dispatch(message))
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
    s.frame.value = got.frame // acknowledged when it has been drawn
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

function dispatch(message: ToPage): void {
  switch (message.type) {
    case 'beat':
      newestBeatMs = message.at_ms
      s.pageMs.value = message.page_ms
      break
    case 'welcome':
      s.welcome.value = message
      s.connection.value = 'open'
      wait = FIRST_WAIT_MS
      try {
        sessionStorage.setItem(KEY, message.key)
      } catch {
        // without storage a reload makes a new operator
      }
      break
    case 'Hello':
      s.robot.value = message
      break
    case 'Status':
      s.state.value = message
      s.stateAt.value = performance.now()
      send({ type: 'got', stream: 'state' })
      break
    case 'who':
      s.who.value = message
      break
    case 'Discs':
      s.discs.value = message.rows
      break
    case 'Polyline':
      s.lines.value = { ...s.lines.value, [message.what]: message.points }
      break
    case 'Docks':
      s.docks.value = message.all
      break
    case 'LinkState':
      s.link.value = message
      break
    case 'HealthReport':
      s.health.value = message
      break
    case 'Records':
      s.records.value = message.all
      break
    case 'PlaybackPosition':
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
