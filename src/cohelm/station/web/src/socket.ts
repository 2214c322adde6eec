// The WebSocket to the station: reconnects it when it is lost, and detects silence.
import { batch } from '@preact/signals'
import { decode, painted, zoned, type MapPart, type ZonePart } from './binary'
import { forget, keep, kept } from './kept'
import type { Do, FromPage, ToPage } from './messages'
import { buttonName } from './panels/format'
import { authorizedFetch, onLogIn, session } from './session'
import * as s from './state'

const KEY = 'cohelm.key'
const FIRST_WAIT_MS = 250
const LONGEST_WAIT_MS = 2000
/** A socket that is silent for so long is replaced, or after twice the station's limit if longer. */
const GIVE_UP_MS = 1500
/** A connection that is not made by then is tried again: a network that is back answers at once. */
const CONNECT_MS = 3000
/** With more bytes waiting to be sent, nothing gets through: no more sticks, of which the next one is newer anyway. */
const FULL = 8192
const STOP_KEY = 'cohelm.stop'
/** A STOP that reaches the robot later than this after it was pressed is explained [ms]. */
const LATE_MS = 2000
/** A STOP that the robot has not answered by then is said to be open [ms]. */
const ANSWER_MS = 1000
/** A STOP of a page that was reloaded is still sent up to this age: whoever opens it later does not know of it [ms]. */
const STOP_LIFE_MS = 600_000
/** Without a scan for this long while states come, the last one is not the present any more [ms]. */
const SCAN_LIFE_MS = 3000

let socket: WebSocket | null = null
/** When something was received last, or the connection was begun. */
let lastReceived = 0
/** When STOP was pressed that nobody has answered [ms, Date.now()], null: none is; and the connection it was sent on. */
let stopping: number | null = null
let stopSentOn: WebSocket | null = null
let wait = FIRST_WAIT_MS
let parts: Promise<unknown> = Promise.resolve()

/** `at_ms` of the newest beat. */
export let newestBeatMs = 0

const PERIODIC: ReadonlySet<string> = new Set(['steer', 'got'])

/** A message from a panel; requests are stamped here. */
type Outgoing = Exclude<FromPage, Do> | Omit<Do, 'echo_ms'>

export function send(message: Outgoing): boolean {
  if (socket?.readyState !== WebSocket.OPEN) {
    if (!PERIODIC.has(message.type) && !('what' in message && message.what === 'stop')) {
      refuse('not sent, as there is no connection to the station: press it again when there is one')
    }
    return false
  }
  if (message.type === 'steer' && socket.bufferedAmount > FULL) return false
  // a request carries the time it was made, by the station's clock
  socket.send(JSON.stringify(message.type === 'do' ? { ...message, echo_ms: newestBeatMs } : message))
  const once = message.type === 'do' ? message.what !== 'stop' : message.type === 'waypoints' && !message.only_check
  if (once) lastSent = { name: message.type === 'do' ? buttonName(message.what) : 'Route', at: performance.now() }
  return true
}

/** What was sent last of what is sent once [ms]. */
let lastSent = { name: '', at: -Infinity }

/** What is asked by the same button, or by one that comes in its place. */
const SAME: { [what: string]: string } = { give: 'take', refuse: 'take', record_stop: 'record' }
const DOUBLE_CLICK_MS = 600
let asked = { what: '', at: -Infinity }

/** Ask the robot for something, for each value. A double click is one click: its second half would undo the first, be
 * refused as done already, or acknowledge the next alarm, which nobody has read. */
export function ask(what: Do['what'], ...values: number[]): void {
  const now = { what: SAME[what] ?? what, at: performance.now() }
  if (now.what === asked.what && now.at - asked.at < DOUBLE_CLICK_MS) return
  asked = now
  s.refused.value = [] // whoever presses on has read them
  for (const value of values.length > 0 ? values : [0]) send({ type: 'do', what, value })
}

/** Send STOP, once on each connection, until the robot says that it is stopped; also after a reload. */
export function stop(): void {
  stopping = Date.now()
  keep('sessionStorage', STOP_KEY, String(stopping))
  stopSentOn = null
  s.lateStop.value = null
  sendStop()
}

/** Of a record that is played, as the space bar does in any player. */
export function pauseOrPlay(): void {
  send({ type: 'play', playing: s.playing.value?.playing !== true, speed: null, seek_s: null })
}

/** The STOP that this tab could not send before it was reloaded. */
function recallStop(): void {
  const pressed = Number(kept('sessionStorage', STOP_KEY) ?? NaN)
  if (!Number.isFinite(pressed)) return
  if (Math.abs(Date.now() - pressed) < STOP_LIFE_MS) {
    stopping = pressed
  } else {
    forget('sessionStorage', STOP_KEY)
    s.lateStop.value = { pressed, sent: null }
  }
}

function sendStop(): void {
  const sent = stopping === null || (socket !== null && stopSentOn === socket)
  if (!sent && send({ type: 'do', what: 'stop', value: 0 })) {
    stopSentOn = socket
    const now = Date.now()
    if (stopping !== null && now - stopping > LATE_MS) s.lateStop.value = { pressed: stopping, sent: now }
  }
  const waits = stopping !== null && socket !== null && stopSentOn === socket
  s.unsentStop.value = stopping !== null && !waits
  s.unansweredStop.value = waits && Date.now() - (stopping ?? 0) > ANSWER_MS
}

/** A LiDAR that has fallen silent is not drawn on, as if it still saw. */
function forgetScans(now: number): void {
  if (s.isReplay.value || s.stateAge(now) > 500) return // what is shown is old altogether, and marked so
  const recent = s.scans.value.filter((scan) => now - scan.at < SCAN_LIFE_MS)
  if (recent.length < s.scans.value.length) s.scans.value = recent
}

export function start(): void {
  recallStop()
  void reconnect()
  onLogIn(() => {
    if (s.connection.value === 'login') void retry()
  })
  setInterval(watch, 50)
  setInterval(() => {
    s.clock.value += 1
    forgetScans(performance.now())
  }, 250)
}

function watch(): void {
  sendStop()
  if (socket === null) return
  const silent = performance.now() - lastReceived
  if (socket.readyState !== WebSocket.OPEN) {
    if (silent > CONNECT_MS) dropSocket(socket)
    return
  }
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
  const key = kept('sessionStorage', KEY)
  if (key !== null) url.searchParams.set('key', key)
  socket?.close()
  const opened = new WebSocket(url, ['cohelm', session() ?? 'none'])
  socket = opened
  lastReceived = performance.now()
  opened.binaryType = 'arraybuffer'
  opened.onopen = () => {
    if (opened === socket) lastReceived = performance.now() // silence counts from now on
  }
  opened.onmessage = (event: MessageEvent<string | ArrayBuffer>) => {
    if (opened === socket) receive(event.data)
  }
  opened.onclose = ({ reason }) => {
    if (opened === socket) s.turnedAway.value = reason
    if (opened === socket && reason !== '') refuse(reason)
    dropSocket(opened)
  }
}

function dropSocket(of: WebSocket): void {
  if (of !== socket) return
  of.onclose = null
  of.close()
  socket = null
  if (lastSent.at > lastReceived) refuse(`${lastSent.name}: the connection broke: if it is not done, press it again`)
  s.connection.value = 'closed'
  setTimeout(() => void reconnect(), wait)
  wait = Math.min(wait * 2, LONGEST_WAIT_MS)
}

async function reconnect(): Promise<void> {
  try {
    // a refused WebSocket gives no reason; this request does
    const answer = await authorizedFetch('./session', { signal: AbortSignal.timeout(CONNECT_MS) })
    if (answer.status === 401) {
      s.connection.value = 'login'
      // what is said next is of another login: nothing of this one's stays, not even who drove
      s.link.value = s.state.value = s.who.value = null
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

/** The robot is stopped, or can not be. */
function answerStop(): void {
  if (socket === null || stopSentOn !== socket) return
  stopping = null
  forget('sessionStorage', STOP_KEY)
}

const MOST_REFUSED = 4

function refuse(text: string): void {
  const others = s.refused.value.filter((one) => one.text !== text)
  s.refused.value = [...others, { text, at: performance.now() }].slice(-MOST_REFUSED)
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
      keep('sessionStorage', KEY, message.key) // else a reload makes a new operator
      break
    case 'Hello': s.robot.value = message; break
    case 'Status':
      if (message.stopped === '' && s.state.value?.stopped) s.lateStop.value = null
      s.state.value = message
      s.stateAt.value = performance.now()
      if (message.stopped !== '') answerStop()
      send({ type: 'got', stream: 'state' })
      break
    case 'who': s.who.value = message; break
    case 'Discs': s.discs.value = message.rows; break
    case 'Polyline': s.lines.value = { ...s.lines.value, [message.what]: message.points }; break
    case 'Docks': s.docks.value = message.all; break
    case 'LinkState': s.link.value = message; break
    case 'HealthReport': s.health.value = message; break
    case 'Records': s.records.value = message.all; break
    case 'PlaybackPosition': s.playing.value = message; break
    case 'checked':
      s.checked.value = message
      if (!message.ok && !message.only_check) refuse(`Route: ${message.why}`)
      break
    case 'refused':
      refuse(`${buttonName(message.what)}: ${message.why}`)
      if (message.what === 'stop') answerStop()
      break
  }
}
