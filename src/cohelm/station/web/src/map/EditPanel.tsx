// The waypoints as a list, with coordinates, and the robot's answer.
import { useState } from 'preact/hooks'
import { useEscape } from '../panels/escape'
import * as s from '../state'
import * as edit from './edit'

/** An input that keeps the typed text while the panel is redrawn. */
function Coordinate({ i, axis, value }: { i: number; axis: 0 | 1; value: number }) {
  const [typed, setTyped] = useState<string | null>(null)
  return (
    <input
      type="number" step="0.25" value={typed ?? value.toFixed(2)}
      aria-label={`Waypoint ${i + 1}, ${axis === 0 ? 'x' : 'y'} in metres`}
      onInput={(event) => {
        setTyped(event.currentTarget.value)
        const given = event.currentTarget.valueAsNumber
        const now = edit.draft.value[i]
        if (!Number.isFinite(given) || now === undefined) return
        edit.move(i, axis === 0 ? [given, now[1]] : [now[0], given])
      }}
      onBlur={() => setTyped(null)}
    />
  )
}

export function EditPanel({ onAdd }: { onAdd: () => void }) {
  useEscape(edit.leave)
  const points = edit.draft.value
  const answer = edit.answer.value
  const answered = answer !== null && !answer.only_check
  const sent = edit.waiting.value && answered
  return (
    <div class="edit" role="dialog" aria-label="Edit the route">
      <p class={points.length > 0 ? 'known' : ''}>Tap the map to add a waypoint, drag one to move it.</p>
      {points.length > 0 && <div class="axes" aria-hidden="true"><span>x [m]</span><span>y [m]</span></div>}
      <ol>
        {points.map((point, i) => (
          <li
            key={i}
            class={[edit.chosen.value === i ? 'chosen' : '', answer?.worst === i ? 'bad' : ''].join(' ')}
            onFocusCapture={() => (edit.chosen.value = i)}
          >
            <span>{answer?.worst === i ? '!' : i + 1}</span>
            {([0, 1] as const).map((axis) => (
              <Coordinate key={axis} i={i} axis={axis} value={point[axis]} />
            ))}
            <button type="button" aria-label={`Remove waypoint ${i + 1}`} onClick={() => edit.remove(i)}>
              ×
            </button>
          </li>
        ))}
      </ol>
      {/* always in sight, however long the list is */}
      <div class="below">
        <p role="status" class={answer !== null && !answer.ok ? 'bad' : ''}>
          {edit.waiting.value && !answered ? 'Sent: the robot has not answered yet …' : answer === null || points.length === 0
            ? ' '
            : answer.ok
              ? sent ? 'The robot accepted the new route.' : 'The robot can follow this route.'
              : `Refused: ${answer.why}`}
        </p>
        <div class="row">
          <button type="button" onClick={onAdd}>Add in the middle</button>
          <button type="button" onClick={() => { edit.draft.value = []; edit.chosen.value = null }}>Clear</button>
          <button type="button" disabled={points.length === 0 || !s.mayDrive.value} onClick={edit.submit}>
            {s.mayDrive.value ? 'Send' : s.linked.value ? 'Send (you are not the driver)' : 'Send (no link)'}
          </button>
          <button type="button" onClick={edit.leave}>Close</button>
          {edit.unsent.value && <button type="button" onClick={edit.discard}>Discard</button>}
        </div>
      </div>
    </div>
  )
}
