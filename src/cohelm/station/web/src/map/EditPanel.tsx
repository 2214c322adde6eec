// Way-points as a list: for the keyboard, for numbers, and for the robot's answer.
import * as s from '../state'
import * as edit from './edit'

export function EditPanel({ onAdd }: { onAdd: () => void }) {
  const points = edit.draft.value
  const answer = s.checked.value
  const sent = edit.waiting.value && answer !== null && !answer.only_check
  return (
    <div class="edit" role="dialog" aria-label="Edit the way">
      <p>Tap the map to add a way-point, drag one to move it.</p>
      <ol>
        {points.map((point, i) => (
          <li
            key={i}
            class={[edit.chosen.value === i ? 'chosen' : '', answer?.worst === i ? 'bad' : ''].join(' ')}
            onFocusCapture={() => (edit.chosen.value = i)}
          >
            <span>{answer?.worst === i ? '!' : i + 1}</span>
            {([0, 1] as const).map((axis) => (
              <input
                key={axis} type="number" step="0.25" value={point[axis].toFixed(2)}
                aria-label={`Way-point ${i + 1}, ${axis === 0 ? 'x' : 'y'} in metres`}
                onChange={(event) => {
                  const value = event.currentTarget.valueAsNumber
                  if (!Number.isFinite(value)) return
                  edit.move(i, axis === 0 ? [value, point[1]] : [point[0], value])
                }}
              />
            ))}
            <button type="button" aria-label={`Remove way-point ${i + 1}`} onClick={() => edit.remove(i)}>
              ×
            </button>
          </li>
        ))}
      </ol>
      <p role="status" class={answer !== null && !answer.ok ? 'bad' : ''}>
        {answer === null || points.length === 0
          ? ' '
          : answer.ok
            ? sent ? 'The robot took the new way.' : 'The robot can go this way.'
            : `Refused: ${answer.why}`}
      </p>
      <div class="row">
        <button type="button" onClick={onAdd}>Add in the middle</button>
        <button type="button" onClick={() => { edit.draft.value = []; edit.chosen.value = null }}>Clear</button>
        <button type="button" disabled={points.length === 0 || !s.youDrive.value} onClick={edit.submit}>
          {s.youDrive.value ? 'Send' : 'Send (you do not drive)'}
        </button>
        <button type="button" onClick={edit.leave}>Close</button>
      </div>
    </div>
  )
}
