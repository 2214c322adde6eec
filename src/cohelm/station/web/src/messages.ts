// Made from src/cohelm/station/messages.py; a test holds the two equal. To make it:
// python -m cohelm.station.typescript > src/cohelm/station/web/src/messages.ts

/** Field of view and mount of the camera, to draw into its picture. */
export interface Camera {
  /** Vertical. */
  field_of_view_rad: number
  mount_x_m: number
  mount_z_m: number
  tilt_rad: number
}

/** One alarm. */
export interface Alarm {
  number: number
  severity: 'notice' | 'warning' | 'alarm'
  text: string
  active: boolean
  acknowledged: boolean
}

/** A place to dock at. */
export interface Dock {
  name: string
  /** Of the docked robot. */
  pose: [number, number, number]
  /** Length of the straight approach that ends there. */
  approach_m: number
}

/** A record on the robot, to be downloaded from /records/. */
export interface RecordFile {
  name: string
  bytes: number
}

/** State of the stick. Sent at 50 Hz while a page is open; also the page's heartbeat. */
export interface Stick {
  type: 'stick'
  /** Sequence number; one that is not newer than the last is dropped. */
  n: number
  /** `at_ms` of the newest beat received: bounds the age of this message. */
  echo_ms: number
  /** Fore-aft, forward positive. */
  x: number
  /** Left-right, left positive. */
  psi: number
  /** False if there is no stick: gamepad disconnected, tab hidden. Not the same as centred. */
  valid: boolean
  /** The operator chose this device, and it was centred since. */
  armed: boolean
  device: 'none' | 'keyboard' | 'gamepad' | 'touch'
  /** Share of the robot's speed that the operator allows. */
  speed_scale: number
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
  /** Deflections up to this are centred, and arm a waiting gamepad. */
  centre: number
}

/** The robot's name, outline and camera. */
export interface Robot {
  type: 'robot'
  name: string
  /** Corners, body frame [m]. */
  outline: Array<[number, number]>
  camera: Camera | null
}

/** The robot's state, up to 30 times a second. */
export interface State {
  type: 'state'
  /** The robot's clock. */
  t_s: number
  /** Age when it was sent to the page. */
  age_ms: number
  pose: [number, number, number]
  localised: 'unknown' | 'exact' | 'good' | 'poor' | 'lost'
  sigma_m: number | null
  reference: [number, number, number] | null
  /** Measured. */
  twist: [number, number]
  /** Blended command of operator and controller, before the filter. */
  nominal: [number, number]
  /** Command at the wheels. */
  applied: [number, number]
  /** Why `applied` differs from `nominal`, or empty. */
  why: string
  verdict: 'untouched' | 'shaped' | 'braking' | 'standing' | 'invalid'
  /** The stick in use on the robot: fore-aft, left-right. */
  stick: [number, number]
  arming: 'absent' | 'waiting' | 'armed'
  /** e^{-V_h}: the controller's share. */
  authority: number | null
  e_p: number | null
  h_m2: number | null
  /** From the outline to the nearest obstacle. */
  clearance_m: number | null
  /** Position of the limiting obstacle. */
  limiting: [number, number] | null
  /** Predicted path, in steps of `ahead_step_s`. */
  ahead: Array<[number, number]>
  ahead_step_s: number
  mode: 'hold' | 'shared' | 'automatic' | 'manual'
  /** Why the robot is stopped; empty: it is not. */
  stopped: string
  speed_cap_mps: number | null
  cap_reason: string
  recording: boolean
  docking: 'away' | 'staged' | 'docking' | 'docked' | 'undocking' | 'between'
  /** Number of the dock, from 1; 0: none. */
  dock: number
}

/** The driver, and the operator that requests the lease. */
export interface Who {
  type: 'who'
  you_drive: boolean
  driver: string | null
  /** The operator that requests the lease from the driver. */
  requester: string | null
  requester_client: number
  you_request: boolean
  /** Time until the request is granted, if the driver does not answer. */
  left_s: number | null
  /** All connected operators. */
  operators: Array<string>
}

/** All alarms that are active or not acknowledged yet, the worst first. */
export interface Alarms {
  type: 'alarms'
  alarms: Array<Alarm>
}

/** Round obstacles: x, y, vx, vy, radius, safe distance. */
export interface Discs {
  type: 'discs'
  rows: Array<[number, number, number, number, number, number]>
}

/** A line on the map; replaces the earlier of its kind. */
export interface Line {
  type: 'line'
  what: 'reference' | 'detour' | 'waypoints'
  points: Array<[number, number]>
}

/** The docks of the site; replaces the earlier ones. */
export interface Docks {
  type: 'docks'
  docks: Array<Dock>
}

/** Quality of the link to the robot; four times a second. */
export interface Link {
  type: 'link'
  connected: boolean
  /** Name of the link. */
  name: string
  /** Why it is not connected; empty while it is. */
  why: string
  round_trip_ms: number | null
  /** Share of our datagrams that were lost. */
  loss: number | null
  /** Age of commands when the robot used them. */
  command_age_ms: number | null
  /** Offset of the robot's clock from the station's. */
  offset_ms: number | null
  /** Worst lateness of a step on the robot in the last second. */
  late_ms: number | null
  battery: number | null
  faults: Array<string>
}

/** The records that can be downloaded, newest first. */
export interface Records {
  type: 'records'
  files: Array<RecordFile>
}

/** Playback position of a replay. */
export interface Playing {
  type: 'playing'
  /** Since the start of the record. */
  at_s: number
  playing: boolean
  speed: number
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
  what: string
  why: string
}

export type FromPage = Stick | Do | Waypoints | Got | Play

export type ToPage = Beat | Welcome | Robot | State | Who | Alarms | Discs | Line | Docks | Link | Records | Playing | Checked | Refused
