// Arrow keys or WASD as a stick that moves at a finite speed.
import { settings } from './settings'
import { towards, type Stick } from './stick'

const KEYS: Record<string, 'fore' | 'aft' | 'left' | 'right'> = {
  ArrowUp: 'fore', KeyW: 'fore', ArrowDown: 'aft', KeyS: 'aft',
  ArrowLeft: 'left', KeyA: 'left', ArrowRight: 'right', KeyD: 'right',
}

const held = new Set<string>()
let x = 0
let psi = 0
let before = 0

/** Whether the focused control takes this key, and not the stick: a slider the arrows, a box to tick none of ours. An arrow
 * that would count a number up or down unseen means the robot. */
export function typing(target: EventTarget | null, code: string): boolean {
  if (!(target instanceof HTMLElement)) return false
  if (target.matches('[type=checkbox]')) return false
  if (target.matches('[type=range]')) return code.startsWith('Arrow')
  if (target.matches('[type=number]')) return code !== 'ArrowUp' && code !== 'ArrowDown'
  return target.matches('input, select, textarea, [contenteditable]')
}

/** Whether the focused control takes the space bar: only where text is written; all else leaves it to STOP. */
export function takesSpace(target: EventTarget | null): boolean {
  if (!(target instanceof HTMLElement) || target.matches('[type=range], [type=number], [type=checkbox]')) return false
  return target.matches('input, textarea, [contenteditable]')
}

/** Whoever sets a slider or a list with the mouse and then presses an arrow key means the robot. */
function leaveWhatThePointerSet(): void {
  let byPointer = false
  const leave = (event: Event) => {
    const at = event.target
    if (byPointer && at instanceof HTMLElement && at.matches('[type=range], [type=checkbox], select')) at.blur()
  }
  addEventListener('pointerdown', () => (byPointer = true), true)
  addEventListener('keydown', () => (byPointer = false), true)
  addEventListener('change', leave)
  addEventListener('pointerup', (event) => {
    if (event.target instanceof HTMLElement && event.target.matches('[type=range]')) leave(event)
  })
}

export function listenToKeys(): void {
  leaveWhatThePointerSet()
  addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) {
      releaseKeys() // with such a key down, some systems do not report the release of another
      return
    }
    // the space bar, which ticks a box elsewhere, stops the robot here
    const field = event.target instanceof HTMLInputElement ? event.target : null
    if (event.code === 'Enter' && !event.repeat && field?.type === 'checkbox') field.click()
    if (KEYS[event.code] === undefined || typing(event.target, event.code)) return
    event.preventDefault()
    if (field?.type === 'number') field.blur()
    // a key that was released by us and is still held must be pressed again
    if (!event.repeat) held.add(event.code)
  })
  addEventListener('keyup', (event) => held.delete(event.code))
  addEventListener('blur', releaseKeys)
  // an open menu or list keeps to itself that a key is released
  addEventListener('contextmenu', releaseKeys)
  addEventListener('focusin', ({ target }) => {
    if (target instanceof HTMLSelectElement) releaseKeys()
  })
}

/** As if no key were down. */
export function releaseKeys(): void {
  held.clear()
}

function direction(plus: string, minus: string): number {
  let sum = 0
  for (const code of held) {
    if (KEYS[code] === plus) sum += 1
    if (KEYS[code] === minus) sum -= 1
  }
  return Math.sign(sum)
}

export function readKeys(now: number): Stick {
  const step = Math.min((now - before) / 1000, 0.1) / settings.value.ramp
  before = now
  // returns to the centre faster than it leaves it, as with a spring
  const to = (value: number, goal: number) => towards(value, goal, goal === 0 ? 2 * step : step)
  x = to(x, direction('fore', 'aft'))
  psi = to(psi, direction('left', 'right'))
  return [x, psi]
}

export function keysHeld(): boolean {
  return held.size > 0
}
