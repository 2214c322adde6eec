// The top line: what is wrong, the worst first, and a button to say that it was seen.
import type { Alarm } from '../messages'
import { send } from '../socket'
import * as s from '../state'
import { once, type Shown } from './once'
import { goOn, idle, useless } from '../input/drive'

const MARK = { alarm: '▲', warning: '◆', notice: '●' } as const

function ours(): Shown[] {
  const out: Shown[] = []
  const say = (severity: Alarm['severity'], text: string) =>
    out.push({ number: -1 - out.length, severity, text, active: true, acknowledged: true, local: true, all: [] })
  const c = s.connection.value
  const why = s.link.value === null || s.link.value.why === '' ? '' : ` (${s.link.value.why})`
  if (c === 'closed' || c === 'connecting') {
    if (s.welcome.value !== null) say('alarm', `No connection to the station${why}. What you see is old. The robot stops by itself.`)
  } else if (c === 'silent') say('alarm', 'The station is silent. What you see is old.')
  else if (s.link.value !== null && !s.link.value.connected && s.robot.value === null) {
    say('notice', `There is no robot yet${s.link.value.why === '' ? '' : `: ${s.link.value.why}`}.`)
  } else if (s.link.value !== null && !s.link.value.connected) {
    say('alarm', `No link to the robot${why}. What you see is old. The robot stops by itself.`)
  }
  const idly = useless.value || (s.youDrive.value ? idle.value : '')
  if (idly !== '') say('warning', `Your stick does not steer: ${idly}.`)
  if (goOn.value !== '') say('notice', `To drive on: ${goOn.value}.`)
  const where = s.state.value?.localised
  if (where === 'lost') say('alarm', 'The robot does not know where it is. Drive it on a little by hand: it crawls, and what it then sees may tell.')
  else if (where === 'poor') say('warning', 'The robot is not sure where it is.')
  return out
}

export function Alarms() {
  const all: Shown[] = [...ours(), ...once(s.alarms.value)]
  const order = { alarm: 0, warning: 1, notice: 2 }
  all.sort((a, b) => order[a.severity] - order[b.severity])
  if (all.length === 0) return <div class="alarms" role="status" aria-label="Alarms">No alarms</div>
  return (
    <div class="alarms" role="alert" aria-label="Alarms">
      {all.map((alarm) => (
        <div key={alarm.number} class={`alarm ${alarm.severity} ${alarm.active ? '' : 'gone'}`}>
          <span aria-hidden="true">{MARK[alarm.severity]}</span>
          <span>
            {alarm.text}
            {!alarm.active && ' (over)'}
          </span>
          {!alarm.local && !alarm.acknowledged && (
            <button type="button" onClick={() => alarm.all.forEach((value) => send({ type: 'do', what: 'acknowledge', value }))}>
              Acknowledge
            </button>
          )}
        </div>
      ))}
    </div>
  )
}
