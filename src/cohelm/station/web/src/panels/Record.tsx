// Recording, on the robot's side.
import { signal } from '@preact/signals'
import { send } from '../socket'
import * as s from '../state'
import { bytes } from './words'

const open = signal(false)

export function Record() {
  if (s.isReplay.value) return null
  const on = s.state.value?.recording === true
  const files = s.records.value
  return (
    <div class="record">
      <button
        type="button" aria-pressed={on} class={on ? 'on' : ''}
        onClick={() => send({ type: 'do', what: on ? 'record_stop' : 'record', value: 0 })}
      >
        {on ? '■ Stop recording' : '● Record'}
      </button>
      <button type="button" aria-expanded={open.value} onClick={() => (open.value = !open.value)}>
        Records ({files.length})
      </button>
      {open.value && (
        <ul class="files" aria-label="Records on the robot">
          {files.length === 0 && <li>none yet</li>}
          {files.map((file) => (
            <li key={file.name}>
              <a href={`./records/${encodeURIComponent(file.name)}`} download={file.name}>{file.name}</a>{' '}
              {bytes(file.bytes)}
            </li>
          ))}
        </ul>
      )}
    </div>
  )
}
