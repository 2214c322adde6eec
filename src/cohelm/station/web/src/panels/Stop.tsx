// The STOP button: always visible, for every operator. A software stop, and labelled so.
import { device } from '../input/drive'
import { pad, stopButtonName } from '../input/gamepad'
import { ask, stop } from '../socket'
import * as s from '../state'

export function Stop() {
  if (s.isReplay.value) return null
  const why = s.state.value?.stopped ?? ''
  const other = !s.youDrive.value && s.linked.value
  return (
    <div class="stop" role="group" aria-label="Stop">
      {/* as it is touched: of a second finger, while a thumb is on a pad, browsers make no click. A click is of keys and ears */}
      <button type="button" class="stop-button" aria-label="Stop the robot. Software stop; also the space bar" onPointerDown={stop} onClick={stop}>
        STOP<small>software stop<span class="keys"> · {device.value === 'gamepad' && pad() !== null ? stopButtonName() : 'Space'}</span></small>
      </button>
      {/* there before it says anything: what is put in with its words is not read out */}
      <div class="contents" role="status">{why !== '' && (
        <div class="stopped">
          <span><b>Stopped:</b> {why}</span>
          {/* why it is grey stands beside it, and is read out with it */}
          {other && <small id="reset-by">{s.nobodyDrives.value ? 'Take over first' : 'by the driver'}</small>}
          <button type="button" disabled={!s.mayDrive.value} aria-describedby={other ? 'reset-by' : undefined} onClick={() => ask('reset')}>
            Reset
          </button>
        </div>
      )}</div>
    </div>
  )
}
