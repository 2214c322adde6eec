// Position in the record, and playback speed.
import { pauseOrPlay, send } from '../socket'
import * as s from '../state'
import { minutes } from './format'

const SPEEDS = [0.25, 0.5, 1, 2, 4, 8, 16]

export function Timeline() {
  const length = s.welcome.value?.replay_s
  const now = s.playing.value
  if (length == null || now === null || now.at === null || now.speed === null) return null
  const play = (part: Partial<{ playing: boolean; speed: number; seek_s: number }>) =>
    send({ type: 'play', playing: null, speed: null, seek_s: null, ...part })
  return (
    <footer class="timeline" aria-label="Replay">
      <button type="button" aria-label={now.playing ? 'Pause' : 'Play'} onClick={pauseOrPlay}>
        {now.playing ? '❚❚' : '▶'}
      </button>
      <span>{minutes(now.at)} / {minutes(length)}</span>
      <input type="range" min="0" max={length} step="0.01" value={now.at} aria-label="Position in the record, seconds"
        onInput={(event) => play({ seek_s: event.currentTarget.valueAsNumber })} />
      <label>speed
        <select value={now.speed} onChange={(event) => play({ speed: Number(event.currentTarget.value) })}>
          {SPEEDS.map((x) => <option key={x} value={x}>{x} ×</option>)}
        </select>
      </label>
    </footer>
  )
}
