// State of the robot and of the link; values out of the normal range are marked.
import * as s from '../state'
import { ms, percent, speed } from './format'

function Row({ name, value, odd = false }: { name: string; value: string; odd?: boolean }) {
  return (
    <tr class={odd ? 'abnormal' : ''}>
      <th scope="row">{name}</th>
      <td>{odd && <span aria-hidden="true">◆ </span>}{value}</td>
    </tr>
  )
}

const over = (value: number | null | undefined, limit: number) => value != null && value > limit

export function LinkPanel() {
  void s.clock.value
  const q = s.link.value
  const state = s.state.value
  const age = s.stateAge(performance.now())
  const cap = state?.speed_cap_mps ?? null
  return (
    <section class="link" aria-label="Link to the robot">
      <table>
        <tbody>
          <Row name="robot" value={s.robot.value?.name ?? '–'} />
          <Row name="localization" value={state === null ? '–' : where(state.localised, state.sigma_m)} odd={state?.localised === 'poor' || state?.localised === 'lost'} />
          <Row name="speed limit" value={cap === null ? 'none' : `${speed(cap)} · ${state?.cap_reason ?? ''}`} odd={cap !== null} />
          {q?.battery != null && <Row name="battery" value={percent(q.battery)} odd={q.battery < 0.2} />}
          {q?.faults.map((fault) => <Row key={fault} name="fault" value={fault} odd />)}
          {!s.isReplay.value && <>
            <Row name="link" value={q?.connected ? q.name : 'not connected'} odd={!q?.connected} />
            <Row name="round trip" value={ms(q?.round_trip_ms)} odd={over(q?.round_trip_ms, 200)} />
            <Row name="packet loss" value={percent(q?.loss)} odd={over(q?.loss, 0.05)} />
            <Row name="command age" value={ms(q?.command_age_ms)} odd={over(q?.command_age_ms, 150)} />
            <Row name="display age" value={age === Infinity ? '–' : `${ms(age)} old`} odd={!(age < 300)} />
            <Row name="page round trip" value={ms(s.pageMs.value)} odd={over(s.pageMs.value, 150)} />
            <Row name="clock offset" value={ms(q?.offset_ms)} />
            <Row name="control loop late by" value={ms(q?.late_ms)} odd={over(q?.late_ms, 20)} />
          </>}
        </tbody>
      </table>
    </section>
  )
}

function where(localised: string, sigma: number | null): string {
  return sigma === null || localised === 'exact' ? localised : `${localised}, ± ${(sigma * 100).toFixed(0)} cm`
}
