// The page.
import { signal } from '@preact/signals'
import { editing } from './map/edit'
import { MapPanel } from './map/MapPanel'
import { Alarms } from './panels/Alarms'
import { Authority } from './panels/Authority'
import { Camera } from './panels/Camera'
import { Driver } from './panels/Driver'
import { LinkPanel } from './panels/LinkPanel'
import { Login } from './panels/Login'
import { Modes } from './panels/Modes'
import { Plots } from './panels/Plots'
import { Record } from './panels/Record'
import { Stop } from './panels/Stop'
import { Timeline } from './panels/Timeline'
import { TouchPads } from './panels/TouchPads'
import * as s from './state'

/** On a phone there is room for one of these at a time. */
const TABS = ['Drive', 'Camera', 'Plots', 'Link'] as const
const tab = signal<(typeof TABS)[number]>('Drive')

export function App() {
  if (s.connection.value === 'login') return <Login />
  const link = s.link.value
  const unlinked = link !== null && !link.connected && s.state.value !== null
  const stale = s.welcome.value !== null && (s.connection.value !== 'open' || unlinked)
  return (
    <div class={`station tab-${tab.value.toLowerCase()} ${stale ? 'stale' : ''} ${s.youDrive.value ? 'driving' : ''} ${editing.value ? 'editing' : ''}`}>
      <header>
        {/* above everything that appears and disappears, so that STOP keeps its position; and first for keys and ears */}
        <div class="head">
          <Stop />
          <Driver />
          <Record />
        </div>
        <Alarms />
        <Refused />
        <nav aria-label="Panels">
          {TABS.map((name) => (
            <button key={name} type="button" aria-pressed={tab.value === name} onClick={() => (tab.value = name)}>
              {name}
            </button>
          ))}
        </nav>
      </header>
      <MapPanel />
      <aside>
        <Modes />
        <Authority />
        <Camera />
        <LinkPanel />
      </aside>
      <Plots />
      <TouchPads />
      <Timeline />
    </div>
  )
}

const SHOWN_MS = 6000

function Refused() {
  void s.clock.value
  const shown = s.refused.value.filter((one) => performance.now() - one.at < SHOWN_MS)
  return <div class="refused" role="status">{shown.map((one) => <div key={one.text}>{one.text}</div>)}</div>
}
