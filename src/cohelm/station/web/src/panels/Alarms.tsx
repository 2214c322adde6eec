// The alarms, the worst first, each with a button to acknowledge it.
import { signal } from '@preact/signals'
import { useEffect, useLayoutEffect, useRef } from 'preact/hooks'
import type { Alarm } from '../messages'
import { ask } from '../socket'
import * as s from '../state'
import { useEscape } from './escape'
import { mergeAlarms, type ShownAlarm } from './mergeAlarms'
import { ago, EMPTY_BATTERY, LOW_BATTERY, percent } from './format'
import { resumeHint, notArmedReason, noEffectReason } from '../input/drive'

const MARK = { alarm: '▲', warning: '◆', notice: '●' } as const

/** A first connection takes no longer; in ticks of the clock. */
const BEGUN = 8

const ALONE = 'must stop by its own time-out: look at it'
/** So the reason begins where nothing drives the robot any more. */
const ENDED = "the robot's process has ended"

/** What the robot does without its driver; empty where it has not said that yet, or the reason does. */
function withoutUs(why: string): string {
  if (s.robot.value === null || why.includes(ALONE)) return ''
  const mode = s.state.value?.mode
  const on = s.robot.value.carry_on && (mode === 'shared' || mode === 'automatic') && !why.startsWith(ENDED)
  return on ? ' The robot drives on alone (--carry-on).' : ' The robot should stop by itself: look at it.'
}

function localAlarms(): ShownAlarm[] {
  const out: ShownAlarm[] = []
  const add = (severity: Alarm['severity'], text: string) =>
    out.push({ number: -1 - out.length, severity, text, active: true, acknowledged: true, kind: 'other', local: true, all: [] })
  // first: a low screen has room for one
  if (s.unsentStop.value) add('alarm', 'STOP is not sent yet: it will be as soon as there is a connection to the station.')
  if (s.unansweredStop.value) add('alarm', 'STOP is sent, but the robot has not answered yet: it is sent on until it does.')
  const c = s.connection.value
  const why = s.link.value === null || s.link.value.why === '' ? '' : ` Reason: ${s.link.value.why}.`
  const next = s.link.value?.why.startsWith(ENDED) ? ' Start it again on the robot: this page connects by itself.' : ''
  // on a phone the end is cut: the reason comes last
  const stale = `the display is stale.${s.who.value?.you_drive === true ? withoutUs(s.link.value?.why ?? '') : ''}`
  if (c === 'closed' || c === 'connecting') {
    if (s.welcome.value === null) {
      const said = s.turnedAway.value || 'the station does not answer'
      if (s.clock.value > BEGUN) add('warning', `No connection yet: ${said}. It is tried again and again.`)
    } else add('alarm', `No connection to the station: ${stale}${why}`)
  } else if (c === 'silent') add('alarm', 'No data from the station: the display is stale.')
  else if (s.link.value !== null && !s.link.value.connected && s.state.value === null) {
    add('notice', `Not connected to a robot yet${s.link.value.why === '' ? '' : `: ${s.link.value.why}`}.`)
  } else if (s.link.value !== null && !s.link.value.connected) {
    add('alarm', `No link to the robot: ${stale}${next}${why}`)
  }
  if (s.failed.value) add('alarm', 'This page has failed at something, and may show what is old: reload it.')
  const late = s.lateStop.value
  if (late !== null) {
    const pressed = new Date(late.pressed).toLocaleString()
    if (late.sent === null) add('alarm', `STOP, pressed ${pressed} in this tab, could not be sent and is now too old: press it again.`)
    else add('notice', `STOP, pressed ${pressed} in this tab, was sent late, ${ago(late.sent - late.pressed)} after: the robot had not answered it before.`)
  }
  const reason = noEffectReason.value || (s.youDrive.value ? notArmedReason.value : '')
  if (s.linked.value && reason !== '') add('warning', `Your stick does not steer: ${reason}.`)
  if (s.linked.value && resumeHint.value !== '') add('notice', `To continue: ${resumeHint.value}.`)
  if (s.present.value?.localised === 'poor') add('warning', 'Localization is uncertain.')
  const battery = (s.present.value === null ? null : s.health.value?.battery) ?? 1
  if (battery < LOW_BATTERY) add(battery < EMPTY_BATTERY ? 'warning' : 'notice', `The battery is at ${percent(battery)}: bring the robot to its charger.`)
  return out
}

/** The robot's alarm of a lost localization says why; here is what its driver can do about it. */
function remedied(alarm: Alarm): Alarm {
  if (alarm.kind !== 'lost') return alarm
  const hint = alarm.active && s.mayDrive.value ? '. In Shared or Manual you can drive by hand (speed is limited), so that it localizes again.' : ''
  return { ...alarm, text: `Localization is ${alarm.text}${hint}` }
}

/** Whether all alarms are shown, over what is below. */
const open = signal(false)
const SMALL = matchMedia('(max-width: 820px), (max-height: 500px)')
const LOW = matchMedia('(max-height: 600px)')
/** The texts, and the width of the window, where one of them was cut. */
const cutAt = signal('')

/** How many alarms there is room for, so that what drives the robot keeps its place. */
function room(): number {
  return !SMALL.matches ? 4 : LOW.matches ? 1 : 2
}

export function Alarms() {
  const ref = useRef<HTMLDivElement>(null)
  void s.clock.value // the screen may have been turned
  const all: ShownAlarm[] = [...localAlarms(), ...mergeAlarms((s.state.value?.alarms ?? []).map(remedied))]
  const order = { alarm: 0, warning: 1, notice: 2 }
  all.sort((a, b) => order[a.severity] - order[b.severity])
  const shown = all.slice(0, room())
  const hidden = all.length - shown.length
  const now = `${innerWidth} ${shown.map(spoken).join()}`
  useLayoutEffect(() => {
    const texts = [...(ref.current?.querySelectorAll('.alarms > .alarm > span:nth-child(2)') ?? [])]
    if (texts.some((one) => one.scrollHeight > one.clientHeight + 1)) cutAt.value = now
  })
  if (all.length === 0) return <div class="alarms" role="status" aria-label="Alarms">{s.state.value === null ? '…' : 'No alarms'}</div>
  const more = hidden > 0 || cutAt.value === now
  return (
    <div ref={ref} class="alarms" role="alert" aria-label="Alarms" aria-atomic="false" aria-relevant="additions"
      aria-live={all[0]?.severity === 'alarm' ? 'assertive' : 'polite'}>
      {shown.map((alarm) => <Row key={spoken(alarm)} alarm={alarm} plain={more && SMALL.matches} />)}
      {more && (
        <button type="button" class="more" aria-expanded={open.value} onClick={() => (open.value = true)}>
          {hidden > 0 ? `${hidden} more` : 'In full'}
        </button>
      )}
      {open.value && more && <All alarms={all} />}
    </div>
  )
}

/** What is read out when it is new or has other words, and not at each second that it counts. */
function spoken({ local, number, text }: ShownAlarm): string {
  return `${local ? '' : number} ${text.replace(/\d+/g, '')}`
}

/** plain: without a button, for which there is no room. */
function Row({ alarm, plain = false }: { alarm: ShownAlarm; plain?: boolean }) {
  return (
    <div class={`alarm ${alarm.severity} ${alarm.active ? '' : 'gone'}`}>
      <span aria-hidden="true">{MARK[alarm.severity]}</span>
      <span>
        {alarm.text}
        {!alarm.active && ' (cleared)'}
      </span>
      {!plain && toAcknowledge(alarm) && <button type="button" onClick={() => acknowledge([alarm])}>Acknowledge</button>}
    </div>
  )
}

/** All of them, whole; STOP stays free above. */
function All({ alarms }: { alarms: ShownAlarm[] }) {
  const close = () => (open.value = false)
  useEscape(close)
  useEffect(() => close, []) // else it would open by itself over the map when there are many again
  const unseen = alarms.filter(toAcknowledge)
  return (
    <div class="all-alarms" role="dialog" aria-label="All alarms" aria-live="off">
      <div class="row">
        <button type="button" onClick={close}>Close</button>
        {unseen.length > 1 && <button type="button" onClick={() => acknowledge(unseen)}>Acknowledge all</button>}
      </div>
      {alarms.map((alarm) => <Row key={spoken(alarm)} alarm={alarm} />)}
    </div>
  )
}

function toAcknowledge(alarm: ShownAlarm): boolean {
  return !alarm.local && !alarm.acknowledged && !s.isReplay.value
}

/** The link carries so many requests at once. */
const AT_ONCE = 8

/** Those alone, and not one that comes meanwhile. */
function acknowledge(alarms: ShownAlarm[]): void {
  ask('acknowledge', ...alarms.flatMap((alarm) => alarm.all).slice(0, AT_ONCE))
}
