// Made from station/messages.py and link/; a test holds them equal. To make it:
// python -m cohelm.station.typescript > src/cohelm/station/web/src/messages.ts

/** The operator's command: the same from the page, or the stick's driver, to the loop. */
export interface Command {
  /** Fore-aft and left-right, forward and left positive. */
  stick: [number, number]
  /** The deflection was just read from a working device; else it is ignored. A lost stick is not a centred one. */
  valid: boolean
  /** The station's part of arming: the operator chose this device and it was centred. */
  armed: boolean
  device: 'none' | 'keyboard' | 'gamepad' | 'touch' | 'force_stick' | 'script'
  /** Share of the robot's speed that the operator allows, in [0, 1]. */
  speed_scale: number
}

/** Who drives. */
export interface Lease {
  /** This client's number, > 0. */
  you: number
  /** The driver's number; 0: nobody. */
  driver: number
  driver_name: string
  /** Client that requests the lease; 0: none. */
  requester: number
  requester_name: string
  /** Time until it is handed over without an answer [s]; NaN where it is not requested, and 0 where the driver sends nothing: whoever requests it has it at once. */
  left: number | null
}

/** Timing of the robot's loop, and of the link to this client. */
export interface TimingReport {
  /** Worst lateness of a step in the last second [s]. */
  late: number | null
  /** Steps that took longer than a period, since the start. */
  overruns: number
  /** Age of this client's newest command, if it drives [s]; else NaN. */
  command_age: number | null
  /** [s] */
  round_trip: number | null
  /** Share of this client's datagrams lost in the last seconds. */
  lost: number | null
  /** Commands of this client not used: too old, out of order, not understood. */
  dropped: number
}

/** An alarm, latched until acknowledged and gone. */
export interface Alarm {
  /** Which alarm it is, > 0; the same one raised again has a new number. */
  number: number
  severity: 'notice' | 'warning' | 'alarm'
  /** Its cause is still there. */
  active: boolean
  acknowledged: boolean
  text: string
  kind: 'other' | 'lost'
}

/** The result of a request or of a proposal. */
export interface Answer {
  number: number
  granted: boolean
  /** Why not, or what follows; may be empty. */
  reason: string
}

/** A dock. */
export interface DockPlace {
  name: string
  /** Of the docked robot, in the map. */
  pose: [number, number, number] | null
  /** Length of the straight way that ends there [m]. */
  approach: number | null
}

/** A record on the robot. */
export interface RecordInfo {
  name: string
  /** [byte] */
  size: number
  /** Unix time; a label only [s]. */
  started: number | null
}

/** The operator's command. Sent at 50 Hz while a page is open; also the page's heartbeat. */
export interface Steer {
  type: 'steer'
  /** Sequence number; one that is not newer than the last is dropped. */
  n: number
  /** `at_ms` of the newest beat received: bounds the age of this message. */
  echo_ms: number
  /** Not valid if there is no stick: gamepad disconnected, tab hidden. */
  command: Command
}

/** A request to do something once. */
export interface Do {
  type: 'do'
  what: 'stop' | 'reset' | 'take' | 'give' | 'refuse' | 'acknowledge' | 'record' | 'record_stop' | 'hold' | 'shared' | 'automatic' | 'manual' | 'dock' | 'undock'
  /** Number of the alarm to acknowledge (0: all), of the client to give the lease to (0: none), or of the dock, from 1 (0: where the robot is). */
  value: number
  /** `at_ms` of the newest beat received when the operator pressed: a request from before a stop is not done after it, however long it was in transit. Null: just now. */
  echo_ms: number | null
}

/** A path for the robot to check and, unless `only_check`, to follow. */
export interface Waypoints {
  type: 'waypoints'
  points: Array<[number, number]>
  only_check: boolean
}

/** Credit: the page has shown a message of this stream, and can take another. */
export interface Got {
  type: 'got'
  stream: 'state' | 'scan' | 'frame'
}

/** Whether a replay runs, how fast, and from where; None: unchanged. */
export interface Play {
  type: 'play'
  playing: boolean | null
  speed: number | null
  seek_s: number | null
}

/** Heartbeat of the station; 25 times a second, whatever the robot does. */
export interface Beat {
  type: 'beat'
  /** The station's clock. */
  at_ms: number
  /** Round trip of a beat and its stick. */
  page_ms: number | null
}

/** First message on every connection. */
export interface Welcome {
  type: 'welcome'
  /** Name of this page, as the driver and the others see it. */
  you: string
  /** The page sends it when it reconnects, to be the same operator again. */
  key: string
  version: string
  /** Length of the record that is shown; None for a robot. */
  replay_s: number | null
  /** A page that receives nothing for so long shows it, and its stick counts as lost. */
  stale_s: number
}

/** The driver, and the operator that requests the lease. */
export interface Who {
  type: 'who'
  you_drive: boolean
  driver: string | null
  /** Whether the robot hears nothing of the driver: nobody drives, and it can be taken over. */
  driver_lost: boolean
  /** The operator that requests the lease from the driver. */
  requester: string | null
  requester_client: number
  you_request: boolean
  /** Time until the request is granted, if the driver does not answer. */
  left_s: number | null
  /** All connected operators. */
  operators: Array<string>
}

/** The robot's answer to waypoints. */
export interface Checked {
  type: 'checked'
  ok: boolean
  only_check: boolean
  why: string
  /** Index of the waypoint at fault, from 0. */
  worst: number | null
}

/** A request of the page was refused, and why. */
export interface Refused {
  type: 'refused'
  what: 'stop' | 'reset' | 'take' | 'give' | 'refuse' | 'acknowledge' | 'record' | 'record_stop' | 'hold' | 'shared' | 'automatic' | 'manual' | 'dock' | 'undock'
  why: string
}

/** Bulk, first: the robot's description. */
export interface Hello {
  type: 'Hello'
  name: string
  /** (k, 2), convex, counter-clockwise, in the body frame [m]. */
  outline: Array<[number, number]>
  /** [m/s] */
  v_max: number | null
  /** [rad/s] */
  omega_max: number | null
  /** Vertical angle of view [rad], x and z of its mount [m], tilt down [rad]; NaN: no camera. */
  camera: [number, number, number, number] | null
  /** In shared and automatic mode it drives on alone when its operator is lost. */
  carry_on: boolean
}

/** Down, at 50 Hz: the robot's state. What a record has too is called as there: as a field of `core.row`, where a tuple is one for each part (`nominal_v`, `nominal_omega`), or of `recorded_status.StatusWords`. */
export interface Status {
  type: 'Status'
  lease: Lease
  mode: 'hold' | 'shared' | 'automatic' | 'manual'
  /** Why it is stopped; empty: it is not. Latched until RESET. */
  stopped: string
  arming: 'absent' | 'waiting' | 'armed'
  /** The deflection in use. */
  stick: [number, number] | null
  /** The automatic part's share of the command, exp(-V_h) (34), in [0, 1]. */
  authority: number | null
  /** In the map. */
  pose: [number, number, number] | null
  /** By the odometry. */
  measured: [number, number] | null
  /** The blend of operator and controller, before the filter. */
  nominal: [number, number] | null
  /** What the wheels get. */
  applied: [number, number] | null
  /** Why applied differs from nominal; empty where it does not. */
  why: string
  /** What the filter did with the nominal command. */
  verdict: 'untouched' | 'shaped' | 'powerless' | 'invalid' | 'braking' | 'standing'
  /** Smallest clearance of the outline to anything [m]. */
  clearance_seen: number | null
  /** Position of the limiting obstacle in the map; NaN: none. */
  limiting: [number, number] | null
  /** Least value of the paper's barrier (22) [m^2]. */
  h: number | null
  /** Tracking error E_P of the paper. */
  e_p: number | null
  /** The desired pose on the path. */
  reference: [number, number, number] | null
  /** [m/s]; infinite where there is none. */
  speed_cap: number | null
  cap_reason: string
  localised: 'unknown' | 'exact' | 'good' | 'poor' | 'lost'
  /** Standard deviation of the position [m]. */
  sigma: number | null
  recording: boolean
  docking: 'away' | 'staged' | 'docking' | 'docked' | 'undocking' | 'between'
  /** At which dock, as `Docks` has them, from 1; 0: at none. */
  dock: number
  timing: TimingReport
  /** The worst first, at most `MOST_ALARMS` and cut; the station adds the others, whole. */
  alarms: Array<Alarm>
  /** To requests that this client repeats, by turns where there are more than `MOST_ANSWERS`; without any, to the newest. A stop up to the largest number is done. */
  answers: Array<Answer>
  /** Predicted path in the map, from now on in equal steps of time, at most 12 [m]. */
  ahead: Array<[number, number]>
  /** Time between two of its points [s]. */
  ahead_step: number | null
  /** The robot's clock when it was sent [s]. */
  stamp: number
  /** Age when it was sent to the page [s]. */
  age: number
}

/** Down: round obstacles, the nearest 40. */
export interface Discs {
  type: 'Discs'
  number: number
  /** (n, 6): x, y, vx, vy, radius, safe distance r_i, in the map, as `core.types`. */
  rows: Array<[number, number, number, number, number, number]>
}

/** Bulk: points in the map, joined; replaces the earlier of its kind. */
export interface Polyline {
  type: 'Polyline'
  what: 'reference' | 'detour' | 'waypoints'
  /** (n, 2) [m] */
  points: Array<[number, number]>
}

/** Bulk: where the robot can dock; replaces the earlier ones. */
export interface Docks {
  type: 'Docks'
  all: Array<DockPlace>
}

/** Bulk: the records on the robot, newest first. */
export interface Records {
  type: 'Records'
  all: Array<RecordInfo>
}

/** Bulk: battery and faults; sent at every change. */
export interface HealthReport {
  type: 'HealthReport'
  /** Share of its charge, in hundredths. */
  battery: number | null
  faults: Array<string>
}

/** State of the link; NaN for what is not known. */
export interface LinkState {
  type: 'LinkState'
  connected: boolean
  /** The robot's address. */
  name: string
  /** Why it is not connected; empty while it is. */
  why: string
  /** [s] */
  round_trip: number | null
  /** Share of the robot's datagrams lost in the last seconds. */
  lost: number | null
  /** The robot's clock less this one [s]. */
  offset: number | null
}

/** Playback position of a replay. */
export interface PlaybackPosition {
  type: 'PlaybackPosition'
  /** Since the start [s]. */
  at: number | null
  playing: boolean
  speed: number | null
}

export type FromPage = Steer | Do | Waypoints | Got | Play

export type ToPage = Beat | Welcome | Who | Checked | Refused | Hello | Status | Discs | Polyline | Docks | Records | HealthReport | LinkState | PlaybackPosition
