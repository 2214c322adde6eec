// Made from src/cohelm/station/messages.py; a test holds the two equal. To make it:
// python -m cohelm.station.typescript > src/cohelm/station/web/src/messages.ts

/** Where the camera looks from, to draw into its picture. */
export interface Camera {
  /** Vertical. */
  field_of_view_rad: number
  mount_x_m: number
  mount_z_m: number
  tilt_rad: number
}

/** One thing a person must know. */
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
  /** Length of the straight way that ends there. */
  approach_m: number
}

/** A record on the robot, to be fetched below /records/. */
export interface RecordFile {
  name: string
  bytes: number
}

/** Where the stick is. Sent at 50 Hz while a page is open; it is the page's heartbeat too. */
export interface Stick {
  type: 'stick'
  /** Counts up; one that is not newer than the last is dropped. */
  n: number
  /** `at_ms` of the newest beat heard: says how old this can be at most. */
  heard_ms: number
  /** Fore-aft, forward positive. */
  x: number
  /** Left-right, left positive. */
  psi: number
  /** False where there is no stick to speak of: pad gone, tab hidden. Not the same as centred. */
  valid: boolean
  /** A person chose this device, and it was centred since. */
  armed: boolean
  device: 'none' | 'keyboard' | 'gamepad' | 'touch'
  /** Share of the robot's speed that the person allows. */
  speed_scale: number
}

/** Something to be done once. */
export interface Do {
  type: 'do'
  what: 'stop' | 'reset' | 'take' | 'give' | 'refuse' | 'acknowledge' | 'record' | 'record_stop' | 'hold' | 'shared' | 'automatic' | 'manual' | 'dock' | 'undock'
  /** Which alarm is acknowledged (0: all); which client is given the robot (0: nobody); at which dock, from 1 (0: where the robot is). */
  value: number
  /** `at_ms` of the newest beat heard when the person pressed: what was pressed before a stop is not done after it, however long it was under way. Null: just now. */
  heard_ms: number | null
}

/** A way for the robot to check and, unless it is only to be checked, to take. */
export interface Waypoints {
  type: 'waypoints'
  points: Array<[number, number]>
  only_check: boolean
}

/** Credit: what was sent has been shown, and more may come. */
export interface Got {
  type: 'got'
  stream: 'state' | 'scan' | 'frame'
}

/** Whether a replay goes on, how fast, and where from; None: as it is. */
export interface Play {
  type: 'play'
  playing: boolean | null
  speed: number | null
  seek_s: number | null
}

/** The station lives; 25 times a second, whatever the robot does. */
export interface Beat {
  type: 'beat'
  /** The station's clock. */
  at_ms: number
  /** How long a beat and its stick took there and back. */
  page_ms: number | null
}

/** First message on every connection. */
export interface Welcome {
  type: 'welcome'
  /** What the driver and the others see this page called. */
  you: string
  /** What the page shows when it comes back, to be the same operator again. */
  key: string
  version: string
  /** Length of the record that is shown; None when it is a robot. */
  replay_s: number | null
  /** The robot's clock at the record's beginning. */
  replay_from_s: number
  /** A page that hears nothing for so long says so, and its stick counts as gone. */
  stale_s: number
  /** Deflections up to this are centred: a gamepad that waits is armed by them. */
  centre: number
}

/** What robot this is. */
export interface Robot {
  type: 'robot'
  name: string
  /** Corners, body frame [m]. */
  outline: Array<[number, number]>
  v_max: number
  omega_max: number
  watchdog_s: number
  on_loss: string
  camera: Camera | null
}

/** The robot now, up to 30 times a second. */
export interface State {
  type: 'state'
  /** The robot's clock. */
  t_s: number
  /** How old this was when it left for the page. */
  age_ms: number
  pose: [number, number, number]
  odometry: [number, number, number]
  localised: 'unknown' | 'exact' | 'good' | 'poor' | 'lost'
  sigma_m: number | null
  reference: [number, number, number] | null
  /** Measured. */
  twist: [number, number]
  /** What person and controller want together, before the filter. */
  nominal: [number, number]
  /** What the wheels get. */
  applied: [number, number]
  /** Why the two differ, or empty. */
  why: string
  verdict: 'untouched' | 'shaped' | 'braking' | 'standing' | 'invalid'
  /** In use on the robot: fore-aft, left-right. */
  stick: [number, number]
  arming: 'absent' | 'waiting' | 'armed'
  /** e^{-V_h}: the controller's share. */
  authority: number | null
  e_p: number | null
  h_m2: number | null
  /** From the outline to the nearest thing. */
  clearance_m: number | null
  /** What held the wish back. */
  limiting: [number, number] | null
  progress: number | null
  /** Predicted path, in steps of `ahead_step_s`. */
  ahead: Array<[number, number]>
  ahead_step_s: number
  mode: 'hold' | 'shared' | 'automatic' | 'manual'
  /** Why it is stopped; empty: it is not. */
  stopped: string
  speed_cap_mps: number | null
  cap_reason: string
  recording: boolean
  docking: 'away' | 'staged' | 'docking' | 'docked' | 'undocking' | 'between'
  /** At which of the docks, from 1; 0: at none. */
  dock: number
}

/** Who drives, and who would like to. */
export interface Who {
  type: 'who'
  you_drive: boolean
  driver: string | null
  /** Who asks the driver for the robot. */
  asking: string | null
  asking_client: number
  you_ask: boolean
  /** Until it is given to who asks, if the driver says nothing. */
  left_s: number | null
  /** All who are connected. */
  operators: Array<string>
}

/** All that are active or not acknowledged yet, the worst first. */
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

/** Where the robot can dock; replaces the earlier ones. */
export interface Docks {
  type: 'docks'
  docks: Array<Dock>
}

/** How good the link to the robot is; four times a second. */
export interface Link {
  type: 'link'
  connected: boolean
  /** What the robot is reached by. */
  name: string
  /** Why it is not connected; empty while it is. */
  why: string
  round_trip_ms: number | null
  /** Share of our datagrams that never came. */
  loss: number | null
  /** How old commands were when the robot used them. */
  command_age_ms: number | null
  state_age_ms: number | null
  /** The robot's clock against the station's. */
  offset_ms: number | null
  /** Worst lateness of a step on the robot in the last second. */
  late_ms: number | null
  battery: number | null
  faults: Array<string>
}

/** The records that can be fetched, newest first. */
export interface Records {
  type: 'records'
  files: Array<RecordFile>
}

/** Where the replay is. */
export interface Playing {
  type: 'playing'
  /** Since the beginning of the record. */
  at_s: number
  playing: boolean
  speed: number
}

/** What the robot says to way-points. */
export interface Checked {
  type: 'checked'
  ok: boolean
  only_check: boolean
  why: string
  /** Which one is to blame, from 0. */
  worst: number | null
}

/** Something the page asked for was not done, and why. */
export interface Refused {
  type: 'refused'
  what: string
  why: string
}

export type FromPage = Stick | Do | Waypoints | Got | Play

export type ToPage = Beat | Welcome | Robot | State | Who | Alarms | Discs | Line | Docks | Link | Records | Playing | Checked | Refused
