// The alarms, the worst first, each with a button to acknowledge it.
import type { Alarm } from '../messages'
import { send } from '../socket'
import * as s from '../state'
import { mergeAlarms, type ShownAlarm } from './mergeAlarms'
import { resumeHint, notArmedReason, noEffectReason } from '../input/drive'

const MARK = { alarm: '▲', warning: '◆', notice: '●' } as const

/** A time as a person says it. */
function ago(ms: number): string {
  return ms < 100_000 ? `${Math.round(ms / 1000)} s` : `${Math.round(ms / 60_000)} min`
}

function localAlarms(): ShownAlarm[] {
  const out: ShownAlarm[] = []
  const add = (severity: Alarm['severity'], text: string) =>
    out.push({ number: -1 - out.length, severity, text, active: true, acknowledged: true, local: true, all: [] })
  const c = s.connection.value
  const why = s.link.value === null || s.link.value.why === '' ? '' : ` (${s.link.value.why})`
  if (c === 'closed' || c === 'connecting') {
    if (s.welcome.value !== null) add('alarm', `No connection to the station${why}. The display is stale. The robot stops by itself.`)
  } else if (c === 'silent') add('alarm', 'No data from the station. The display is stale.')
  else if (s.link.value !== null && !s.link.value.connected && s.robot.value === null) {
    add('notice', `Not connected to a robot yet${s.link.value.why === '' ? '' : `: ${s.link.value.why}`}.`)
  } else if (s.link.value !== null && !s.link.value.connected) {
    add('alarm', `No link to the robot${why}. The display is stale. The robot stops by itself.`)
  }
  if (s.unsentStop.value) add('alarm', 'STOP is not sent yet: it will be as soon as there is a connection to the station.')
  if (s.unansweredStop.value) add('alarm', 'STOP is sent, but the robot has not answered yet: it is sent on until it does.')
  const late = s.lateStop.value
  if (late !== null) {
    const pressed = new Date(late.pressed).toLocaleString()
    if (late.sent === null) add('alarm', `STOP, pressed ${pressed} in this tab, could not be sent and is now too old: press it again.`)
    else add('notice', `STOP, pressed ${pressed} in this tab, was sent late, ${ago(late.sent - late.pressed)} after: there was no connection.`)
  }
  const reason = noEffectReason.value || (s.youDrive.value ? notArmedReason.value : '')
  if (reason !== '') add('warning', `Your stick does not steer: ${reason}.`)
  if (resumeHint.value !== '') add('notice', `To continue: ${resumeHint.value}.`)
  const localised = s.state.value?.localised
  if (localised === 'lost') add('alarm', 'Localization is lost. Drive on a little by hand (speed is limited), so that it can localize again.')
  else if (localised === 'poor') add('warning', 'Localization is uncertain.')
  return out
}

export function Alarms() {
  const all: ShownAlarm[] = [...localAlarms(), ...mergeAlarms(s.state.value?.alarms ?? [])]
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
            {!alarm.active && ' (cleared)'}
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
