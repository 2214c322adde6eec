// The driver, and the requests to change it.
import type { Who } from '../messages'
import { ask } from '../socket'
import * as s from '../state'
import { modeName } from './format'

const HOLD_WITHIN_MS = 1000

/** Since when this page drives [ms, performance.now()]. */
let droveAt = -Infinity
let drove = false
s.who.subscribe((who) => {
  const now = who?.you_drive === true
  if (now && !drove) droveAt = performance.now()
  drove = now
})
/** So long after *Take over* its place, where *Release* is then, is not pressed on purpose [ms]. */
const DOUBLE_CLICK_MS = 600

/** Hold first: a moving robot whose lease is released stops with an alarm. */
function release(): void {
  if (performance.now() - droveAt < DOUBLE_CLICK_MS) return
  if (drives()) ask('hold')
  const since = performance.now()
  const handBack = () => {
    if (drives() && performance.now() - since < HOLD_WITHIN_MS) setTimeout(handBack, 20)
    else ask('give')
  }
  handBack()
}

function drives(): boolean {
  const now = s.state.value
  return now !== null && now.mode !== 'hold' && now.stopped === ''
}

export function Driver() {
  const who = s.who.value
  if (s.isReplay.value) return <Replay />
  if (who === null) return <div class="driver">{s.linked.value || s.welcome.value === null ? '…' : 'No link'}</div>
  const linked = s.linked.value // without it, who drove then may not drive now
  const mine = linked && who.you_drive
  // without a link the question stays for as long as it may still be asked, but nobody knows for how long
  const left = who.left_s === null || !linked ? '' : ` (${Math.max(0, Math.ceil(who.left_s))} s)`
  return (
    <div class="driver" role="group" aria-label="Who drives">
      <span role="status">
        {!linked ? 'No link' : mine ? <strong>You drive</strong> : who.driver === null ? 'No driver' : driverLine(who)}
        {linked && who.operators.length > 1 && (
          <small> · {who.operators.length} connected, you are {s.welcome.value?.you}</small>
        )}
      </span>
      {/* each with a key: none is made of another, whose focus it would have */}
      {mine && who.requester === null && <button key="release" type="button" onClick={() => release()}>Release</button>}
      {who.you_drive && who.requester !== null && (linked || s.present.value !== null) && (
        <span class="requester" role="alert">
          {/* the seconds are not read out, each of them, over the buttons' names */}
          {who.requester} requests control<span aria-hidden="true">{left}</span>
          <button type="button" onClick={() => ask('give', who.requester_client)}>Hand over</button>
          <button type="button" onClick={() => ask('refuse')}>Keep</button>
        </span>
      )}
      {!who.you_drive && s.nobodyDrives.value && <button key="take" type="button" onClick={() => ask('take')}>Take over</button>}
      {linked && !who.you_drive && !s.nobodyDrives.value && !who.you_request && (
        <button key="ask" type="button" onClick={() => ask('take')}>Request control</button>
      )}
      {linked && who.you_request && <span role="status">requested<span aria-hidden="true">{left}</span></span>}
    </div>
  )
}

function driverLine({ driver, driver_lost }: Who): string {
  return driver_lost ? `${driver} drove; connection lost` : `${driver} drives`
}

/** Driver, mode and stop reason of a record; read-only. */
function Replay() {
  const now = s.state.value
  const driver = s.who.value?.driver
  const mode = now === null ? '' : modeName(now.mode)
  return (
    <div class="driver" role="group" aria-label="Replay of a record">
      <strong>Replay</strong>
      {driver != null && <span>{driver} drives</span>}
      {mode !== '' && <span>mode: {mode}</span>}
      {now !== null && now.stopped !== '' && <span class="stopped"><b>Stopped:</b> {now.stopped}</span>}
    </div>
  )
}
