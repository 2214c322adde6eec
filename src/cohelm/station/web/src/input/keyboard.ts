// Arrow keys or WASD as a stick that moves at a finite speed.
import { settings } from './settings'
import { towards } from './shape'
import type { Reading } from './source'

const KEYS: Record<string, 'fore' | 'aft' | 'left' | 'right'> = {
  ArrowUp: 'fore', KeyW: 'fore', ArrowDown: 'aft', KeyS: 'aft',
  ArrowLeft: 'left', KeyA: 'left', ArrowRight: 'right', KeyD: 'right',
}

const held = new Set<string>()
let x = 0
let psi = 0
let before = 0

/** Whether keys belong to a control that has the focus, and not to the stick. */
export function typing(target: EventTarget | null): boolean {
  if (!(target instanceof HTMLElement)) return false
  return target.matches('input, select, textarea, [contenteditable], [data-keys]')
}

export function listenToKeys(): void {
  addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) {
      letGoOfKeys() // with such a key down, some systems do not tell when another comes up
      return
    }
    if (KEYS[event.code] === undefined || typing(event.target)) return
    event.preventDefault()
    // a key that was let go of here, and is held down still, must be pressed again
    if (!event.repeat) held.add(event.code)
  })
  addEventListener('keyup', (event) => held.delete(event.code))
  addEventListener('blur', letGoOfKeys)
}

/** As if no key were down. */
export function letGoOfKeys(): void {
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

export function readKeys(now: number): Reading {
  const step = Math.min((now - before) / 1000, 0.1) / settings.value.ramp
  before = now
  // back to the centre faster than away from it, as a spring would
  const to = (value: number, goal: number) => towards(value, goal, goal === 0 ? 2 * step : step)
  x = to(x, direction('fore', 'aft'))
  psi = to(psi, direction('left', 'right'))
  return { present: true, x, psi }
}

export function keysHeld(): boolean {
  return held.size > 0
}
