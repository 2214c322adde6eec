// The STOP button: always visible, for every operator. A software stop, and labelled so.
import { send, stop } from '../socket'
import * as s from '../state'

export function Stop() {
  if (s.isReplay.value) return null
  const why = s.state.value?.stopped ?? ''
  return (
    <div class="stop">
      {why !== '' && (
        <div class="stopped" role="status">
          <span><b>Stopped:</b> {why}</span>
          <button type="button" disabled={!s.youDrive.value} onClick={() => send({ type: 'do', what: 'reset', value: 0 })}>
            Reset
          </button>
        </div>
      )}
      <button type="button" class="stop-button" aria-label="Stop the robot. Software stop; also the space bar" onClick={stop}>
        STOP<small>software stop<span class="keys"> · Space</span></small>
      </button>
    </div>
  )
}
