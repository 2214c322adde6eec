// State of the robot and of the link; values out of the normal range are marked.
import * as s from '../state'
import { ago, LOW_BATTERY, localization, ms, percent, speed } from './format'

function Row({ name, value, odd = false }: { name: string; value: string; odd?: boolean }) {
  return (
    <tr class={odd ? 'abnormal' : ''}>
      <th scope="row">{name}</th>
      <td>{odd && <span aria-hidden="true">◆ </span>}{value}</td>
    </tr>
  )
}

const inMs = (seconds: number | null | undefined) => (seconds == null ? null : seconds * 1000)

const over = (value: number | null | undefined, limit: number) => value != null && value > limit

export function LinkPanel() {
  void s.clock.value
  const q = s.linked.value ? s.link.value : null // of a link that is gone there is no round trip
  const page = s.connection.value === 'open' ? s.pageMs.value : null
  const state = s.present.value
  const health = state === null ? null : s.health.value
  const age = s.stateAge(performance.now())
  const timing = state?.timing
  const cap = state?.speed_cap ?? null
  return (
    <section class="link" aria-label="Link to the robot">
      <table>
        <tbody>
          <Row name="robot" value={s.robot.value?.name ?? '–'} />
          <Row name="localization" value={state === null ? '–' : localization(state)} odd={state?.localised === 'poor' || state?.localised === 'lost'} />
          <Row name="speed limit" value={state === null ? '–' : cap === null ? 'none' : `${speed(cap)} · ${state.cap_reason}`} odd={cap !== null} />
          {health?.battery != null && <Row name="battery" value={percent(health.battery)} odd={health.battery < LOW_BATTERY} />}
          {health?.faults.map((fault) => <Row key={fault} name="fault" value={fault} odd />)}
          {!s.isReplay.value && <>
            <Row name="link" value={q?.connected ? q.name : 'not connected'} odd={!q?.connected} />
            <Row name="round trip" value={ms(inMs(q?.round_trip))} odd={over(q?.round_trip, 0.2)} />
            <Row name="packet loss" value={percent(q?.lost)} odd={over(q?.lost, 0.05)} />
            <Row name="command age" value={ms(inMs(timing?.command_age))} odd={over(timing?.command_age, 0.15)} />
            <Row name="display age" value={age === Infinity ? '–' : `${ago(age)} old`} odd={!(age < 300)} />
            <Row name="page round trip" value={ms(page)} odd={over(page, 150)} />
            <Row name="clock offset" value={ms(inMs(q?.offset))} />
            <Row name="control loop late by" value={ms(inMs(timing?.late))} odd={over(timing?.late, 0.02)} />
          </>}
        </tbody>
      </table>
    </section>
  )
}
