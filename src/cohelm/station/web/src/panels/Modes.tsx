// Mode, speed and stick settings.
import { signal } from '@preact/signals'
import { choose, device, speedScale } from '../input/drive'
import { pad, pads, takeUp } from '../input/gamepad'
import { change, DEFAULTS, settings } from '../input/settings'
import { DEVICE_NAMES, type Device } from '../input/stick'
import { routeTo } from '../map/view'
import type { DockPlace } from '../messages'
import { ask, send } from '../socket'
import * as s from '../state'
import { useEscape } from './escape'
import { MODES, percent, tidy } from './format'

const open = signal(false)
const MOST_BUTTONS = 4
const SMALL = matchMedia('(max-width: 820px), (max-height: 500px)')

export function Modes() {
  if (s.isReplay.value) return null
  const now = s.present.value?.mode
  return (
    <section class="modes" aria-label="How to drive">
      {/* no radio buttons: of these a screen reader says that arrow keys choose, and here they drive, wherever the focus is */}
      <div role="group" aria-label="Mode" class="segments">
        {MODES.map(([mode, name, meaning]) => (
          <button key={mode} type="button" aria-pressed={now === mode} title={s.mayDrive.value ? meaning : `${meaning} (the driver chooses)`}
            disabled={!s.mayDrive.value} onClick={() => ask(mode)}>
            {name}
          </button>
        ))}
      </div>
      <Docks />
      <div class="speed">
        <label class="speed">
          your speed {percent(speedScale.value)}
          <input type="range" min="0.1" max="1" step="0.1" value={speedScale.value} disabled={!s.mayDrive.value}
            aria-label="Your speed: share of the full speed" aria-valuetext={percent(speedScale.value)}
            onInput={(event) => (speedScale.value = event.currentTarget.valueAsNumber)} />
        </label>
        <button type="button" aria-expanded={open.value} onClick={() => (open.value = !open.value)}>Stick settings</button>
      </div>
      {open.value && <StickSettings />}
    </section>
  )
}

/** State and actions at a dock; elsewhere, the routes to the docks. */
function Docks() {
  const now = s.state.value
  if (now === null) return null
  const name = s.docks.value[now.dock - 1]?.name
  if (name === undefined) return <RoutesToDocks />
  const at = now.docking
  return (
    <div class="row docks" role="group" aria-label="Dock">
      {at === 'docking' && <span role="status">docking at {name} …</span>}
      {at === 'undocking' && <span role="status">undocking from {name} …</span>}
      {at === 'docked' && <span role="status">docked at {name}</span>}
      {(at === 'staged' || at === 'between') && (
        <button type="button" disabled={!s.mayDrive.value} onClick={() => ask('dock', now.dock)}>Dock at {name}</button>
      )}
      {(at === 'docked' || at === 'between') && (
        <button type="button" disabled={!s.mayDrive.value} onClick={() => ask('undock', now.dock)}>Undock</button>
      )}
    </div>
  )
}

/** Routes to follow once a mode is chosen; the robot refuses with a reason. */
function RoutesToDocks() {
  const docks = s.docks.value
  if (docks.length === 0) return null
  const title = "Route to the start of the dock's approach; then choose Auto or Shared"
  const go = (dock: DockPlace | undefined) => {
    if (dock !== undefined) send({ type: 'waypoints', points: routeTo(dock), only_check: false })
  }
  if (docks.length > (SMALL.matches ? 1 : MOST_BUTTONS)) {
    return (
      <div class="row docks" role="group" aria-label="Dock">
        <select aria-label="Route to a dock" title={title} disabled={!s.mayDrive.value} value=""
          onChange={(e) => { go(docks.find((dock) => dock.name === e.currentTarget.value)); e.currentTarget.value = '' }}>
          <option value="">Route to …</option>
          {docks.map((dock) => <option key={dock.name} value={dock.name}>{dock.name}</option>)}
        </select>
      </div>
    )
  }
  return (
    <div class="row docks" role="group" aria-label="Dock">
      {docks.map((dock) => (
        <button key={dock.name} type="button" disabled={!s.mayDrive.value} title={title} onClick={() => go(dock)}>
          Route to {dock.name}
        </button>
      ))}
    </div>
  )
}

/** By which the numbers of a pad's axes and buttons are found, where they are not the usual ones. */
function Moved() {
  void s.clock.value
  const one = pad()
  if (one === null) return null
  const held = one.buttons.flatMap((button, i) => (button.pressed ? [`button ${i}`] : []))
  const axes = one.axes.map((value, i) => `axis ${i}: ${tidy(value)}`)
  return <small aria-label="Moved now">{[...axes, ...held].join(' · ')}</small>
}

function WhichPad() {
  const take = (index: number) => { takeUp(index); choose('gamepad') }
  return (
    <label>gamepad
      <select value={pad()?.index} onChange={(e) => take(Number(e.currentTarget.value))}>
        {pads().map((one) => <option key={one.index} value={one.index}>{one.index + 1}: {one.id}</option>)}
      </select>
    </label>
  )
}

function StickSettings() {
  useEscape(() => (open.value = false))
  const set = settings.value
  const axes = pad()?.axes.length ?? 4
  const numbers = Array.from({ length: axes }, (_, i) => i)
  const axis = (name: 'foreAft' | 'leftRight', label: string) => (
    <label>{label}
      <select value={set[name]} onChange={(e) => change({ [name]: Number(e.currentTarget.value) })}>
        {numbers.map((i) => <option key={i} value={i}>axis {i}</option>)}
      </select>
    </label>
  )
  const tick = (name: 'foreAftTurned' | 'leftRightTurned' | 'rumble', label: string, of = '') => (
    <label><input type="checkbox" aria-label={`${of} ${label}`.trim()} checked={set[name]} onChange={(e) => change({ [name]: e.currentTarget.checked })} /> {label}</label>
  )
  const slide = (name: 'deadBand' | 'curve' | 'ramp', label: string, least: number, most: number) => (
    <label>{label} {set[name].toFixed(2)}
      <input type="range" min={least} max={most} step="0.01" value={set[name]} onInput={(e) => change({ [name]: e.currentTarget.valueAsNumber })} />
    </label>
  )
  return (
    <div class="settings" role="dialog" aria-label="Stick settings">
      <label>device
        <select value={device.value} onChange={(e) => choose(e.currentTarget.value as Device)}>
          {(['keyboard', 'gamepad', 'touch'] as const).map((d) => <option key={d} value={d}>{DEVICE_NAMES[d]}</option>)}
        </select>
      </label>
      {pads().length > 1 ? <WhichPad /> : <p>{pad()?.id ?? 'No gamepad; plug one in and press a button on it.'}</p>}
      <Moved />
      {axis('foreAft', 'fore-aft')}{tick('foreAftTurned', 'inverted', 'fore-aft')}
      {axis('leftRight', 'left-right')}{tick('leftRightTurned', 'inverted', 'left-right')}
      {slide('deadBand', 'dead band', 0, 0.5)}{slide('curve', 'expo (fine near the centre)', 0, 1)}
      {slide('ramp', 'keyboard: seconds to full deflection', 0.05, 2)}
      {tick('rumble', 'rumble near obstacles')}
      <label>stop button
        <input type="number" min="0" max="31" value={set.stopButton} onChange={(e) => change({ stopButton: e.currentTarget.valueAsNumber })} />
      </label>
      <label>resume button
        <input type="number" min="0" max="31" value={set.goOnButton} onChange={(e) => change({ goOnButton: e.currentTarget.valueAsNumber })} />
      </label>
      <div class="row">
        <button type="button" onClick={() => change(DEFAULTS)}>Defaults</button>
        <button type="button" onClick={() => (open.value = false)}>Close</button>
      </div>
    </div>
  )
}
