// A gamepad or joystick of the browser.
import { settings } from './settings'
import { lastChange, NO_CHANGE, shaped, silentFor, type LastChange, type Reading } from './stick'

/** The pads whose stop button is held. */
let stopHeld = new Set<number>()
let changed: LastChange = NO_CHANGE

/** Index of the pad that is used; null: none was yet. */
let inUse: number | null = null
/** The pads of which a button is held. */
let pressing = new Set<number>()

export function pads(): Gamepad[] {
  return navigator.getGamepads().filter((one): one is Gamepad => one?.connected === true)
}

/** Use this pad, and no other until it is taken up. */
export function takeUp(index: number): void {
  inUse = index
}

/** The pad that is used, at first the first one; null: it is unplugged. No other takes its place by itself: in the
 * middle of a drive it would steer as it lies. */
export function pad(): Gamepad | null {
  const all = pads()
  inUse ??= all[0]?.index ?? null
  return all.find((one) => one.index === inUse) ?? null
}

/** In place of one that is unplugged, the pad of which a button is pressed. */
function takeUpPressed(): void {
  const held = new Set(pads().filter((one) => one.buttons.some((button) => button.pressed)).map((one) => one.index))
  const fresh = [...held].find((index) => !pressing.has(index))
  if (fresh !== undefined && pad() === null) inUse = fresh
  pressing = held
}

const GONE = 'the gamepad is disconnected'

/** now: [ms]. A gamepad that stays deflected without any change counts as disconnected. */
export function readPad(now: number): Reading {
  const one = pad()
  takeUpPressed() // read from the next time on: it is not armed before
  const set = settings.value
  const fore = one?.axes[set.foreAft]
  const left = one?.axes[set.leftRight]
  changed = lastChange(changed, one, now)
  if (one === null) return pads().length === 0 ? GONE : `${GONE}; press a button of the one that you take up`
  if (fore === undefined || left === undefined) return 'the gamepad has no such axis: see Stick settings'
  const x = shaped(set.foreAftTurned ? -fore : fore, set)
  const psi = shaped(set.leftRightTurned ? -left : left, set)
  const silent = silentFor(changed, x !== 0 ? fore : 0, psi !== 0 ? left : 0, now)
  if (silent > 0) return `the gamepad has sent nothing new for ${silent} s: centre its stick`
  return Number.isFinite(fore) && Number.isFinite(left) ? [x, psi] : GONE
}

/** Whether the stop button of any gamepad was pressed since the last call. */
export function padStops(): boolean {
  const held = new Set<number>()
  for (const one of navigator.getGamepads()) {
    if (one?.connected && one.buttons[settings.value.stopButton]?.pressed) held.add(one.index)
  }
  const pressed = [...held].some((index) => !stopHeld.has(index))
  stopHeld = held
  return pressed
}

/** Whether the pad's resume button is held. */
export function padResumes(): boolean {
  const { goOnButton, stopButton } = settings.value
  return goOnButton !== stopButton && (pad()?.buttons[goOnButton]?.pressed ?? false)
}

/** Name of that button. */
export function resumeButtonName(): string {
  const number = settings.value.goOnButton
  return number === 0 && pad()?.mapping === 'standard' ? 'A or ✕ of the gamepad' : `button ${number} of the gamepad`
}

/** Name of the stop button. */
export function stopButtonName(): string {
  const number = settings.value.stopButton
  return number === 1 && pad()?.mapping === 'standard' ? 'B or ○' : `button ${number}`
}

const NEAR_M = 0.3
const RUMBLE_MS = 200
let rumbledAt = 0

/** Rumble near an obstacle: the nearer, the stronger. */
export function rumble(clearance: number | null, now: number): void {
  if (clearance === null || clearance >= NEAR_M || !settings.value.rumble || now - rumbledAt < RUMBLE_MS) return
  rumbledAt = now
  const strength = Math.min(1, 1 - Math.max(clearance, 0) / NEAR_M)
  void pad()
    ?.vibrationActuator?.playEffect('dual-rumble', {
      duration: RUMBLE_MS, strongMagnitude: strength, weakMagnitude: strength * 0.5,
    })
    .catch(() => undefined)
}
