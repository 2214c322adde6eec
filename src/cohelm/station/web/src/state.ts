// The page's state as signals: written by the socket, read by the panels.
import { computed, signal } from '@preact/signals'
import type { Frame, Grid, Scan, Zones } from './binary'
import type * as m from './messages'

/** State of the connection to the station. */
export type Connection = 'connecting' | 'open' | 'silent' | 'closed' | 'login'

export const connection = signal<Connection>('connecting')
export const welcome = signal<m.Welcome | null>(null)
export const robot = signal<m.Hello | null>(null)
export const state = signal<m.Status | null>(null)
export const who = signal<m.Who | null>(null)
export const discs = signal<m.Discs['rows']>([])
export const lines = signal<Partial<Record<m.Polyline['what'], Array<[number, number]>>>>({})
export const docks = signal<m.DockPlace[]>([])
export const link = signal<m.LinkState | null>(null)
export const health = signal<m.HealthReport | null>(null)
export const records = signal<m.RecordInfo[]>([])
export const playing = signal<m.PlaybackPosition | null>(null)
export const checked = signal<m.Checked | null>(null)
/** Why the station closed the last connection; empty: it did not say. */
export const turnedAway = signal('')
/** What was refused lately, oldest first. */
export const refused = signal<Array<{ text: string; at: number }>>([])
export const pageMs = signal<number | null>(null)
/** Whether STOP was pressed and could not be sent yet. */
export const unsentStop = signal(false)
/** Whether STOP was sent, and the robot has not answered in time. */
export const unansweredStop = signal(false)
/** A STOP that was sent late: when it was pressed, and when it was sent; or never, as it was too old [ms, Date.now()]. */
export const lateStop = signal<{ pressed: number; sent: number | null } | null>(null)

export const grid = signal<Grid | null>(null)
export const zones = signal<Zones[]>([])
/** The newest of each LiDAR. */
export const scans = signal<Scan[]>([])
export const frame = signal<Frame | null>(null)

/** Whether the page failed at something, and may show what is old. */
export const failed = signal(false)

/** When the newest state was received [ms, performance.now()]; its age is counted from there. */
export const stateAt = signal(0)
/** What the robot said is not shown as the present for longer without a word of it [ms]: long enough for an interruption. */
const PRESENT_MS = 3000
/** Ticks four times a second, for what ages without a message. */
export const clock = signal(0)

export const isReplay = computed(() => welcome.value?.replay_s != null)
/** Whether nobody drives: the lease is free, or the robot hears nothing of its driver. */
export const nobodyDrives = computed(() => who.value === null || who.value.driver === null || who.value.driver_lost)
export const youDrive = computed(() => who.value?.you_drive === true && connection.value === 'open')

/** Whether what is shown is the robot's present state, as far as the station knows. */
export const linked = computed(() => connection.value === 'open' && link.value?.connected !== false)

/** Whether what the driver presses can reach the robot. */
export const mayDrive = computed(() => youDrive.value && linked.value)

/** The robot's state, as far as it may still be true: nothing where none came for some seconds. */
export const present = computed(() => {
  void clock.value
  return isReplay.value || stateAge(performance.now()) < PRESENT_MS ? state.value : null
})

/** Of the window, by which one is told from another robot's. */
export const title = computed(() => {
  const now = welcome.value !== null && !linked.value ? 'No link' : state.value?.stopped ? 'Stopped' : youDrive.value ? 'You drive' : ''
  return [isReplay.value ? 'Replay' : now, robot.value?.name ?? 'cohelm station'].filter((part) => part !== '').join(' · ')
})

/** Age of the displayed state [ms]. */
export function stateAge(now: number): number {
  const s = state.value
  return s === null ? Infinity : s.age * 1000 + (now - stateAt.value)
}
