// Who drives, and the ways to change it.
import { send } from '../socket'
import * as s from '../state'
import type { Do } from '../messages'

function ask(what: Do['what'], value = 0): void {
  send({ type: 'do', what, value })
}

export function Driver() {
  const who = s.who.value
  if (s.isReplay.value) return <div class="driver"><strong>Replay</strong> of a record</div>
  if (who === null) return <div class="driver">…</div>
  const left = who.left_s === null ? '' : ` (${Math.max(0, Math.ceil(who.left_s))} s)`
  return (
    <div class="driver" role="group" aria-label="Who drives">
      <span role="status">
        {who.you_drive ? <strong>You drive</strong> : who.driver === null ? 'Nobody drives' : `${who.driver} drives`}
        {who.operators.length > 1 && <small> · {who.operators.length} here</small>}
      </span>
      {who.you_drive && who.asking === null && <button type="button" onClick={() => ask('give')}>Release</button>}
      {who.you_drive && who.asking !== null && (
        <span class="asking" role="alert">
          {who.asking} asks for the robot{left}
          <button type="button" onClick={() => ask('give', who.asking_client)}>Hand over</button>
          <button type="button" onClick={() => ask('refuse')}>Keep</button>
        </span>
      )}
      {!who.you_drive && who.driver === null && <button type="button" onClick={() => ask('take')}>Take over</button>}
      {!who.you_drive && who.driver !== null && !who.you_ask && (
        <button type="button" onClick={() => ask('take')}>Ask for it</button>
      )}
      {who.you_ask && <span role="status">asked{left}</span>}
    </div>
  )
}
