// Editing waypoints: add, drag, remove, have the robot check them, send them.
import { computed, signal } from '@preact/signals'
import { clamp } from '../input/stick'
import { send } from '../socket'
import * as s from '../state'
import type { Point } from './view'

export const editing = signal(false)
export const draft = signal<Point[]>([])
export const chosen = signal<number | null>(null)
/** Sent and not answered yet. */
export const waiting = signal(false)
/** What the robot has of it: its own route, as editing began, or one that it accepted. */
const safe = signal<Point[]>([])
let sent: Point[] = []
/** Whether the draft is no route of the robot's: it is kept while its panel is closed. */
export const unsent = computed(() => draft.value.length > 0 && draft.value !== safe.value)
s.checked.subscribe((answer) => {
  if (answer !== null && !answer.only_check) safe.value = answer.ok ? sent : []
})
/** Whether an answer to a check is of this draft: none is that comes after it was discarded or sent. */
const checking = signal(false)
/** The robot's answer to the draft. */
export const answer = computed(() => (s.checked.value?.only_check && !checking.value ? null : s.checked.value))

const CHECK_EVERY_MS = 200
/** What one message takes, MOST_WAYPOINTS of link/bulk_messages.py, and the largest coordinate [m]. */
const MOST = 500
const FARTHEST = 1e5
let checkedAt = 0
let later: ReturnType<typeof setTimeout> | undefined

export function begin(): void {
  editing.value = true
  if (unsent.value) check()
  else discard()
}

/** The robot's route, in place of what was edited. */
export function discard(): void {
  clearTimeout(later)
  safe.value = draft.value = [...(s.lines.value.waypoints ?? [])]
  chosen.value = null
  forget()
}

export function leave(): void {
  editing.value = false
  forget()
}

/** What the robot answers to what was asked before is of no interest any more. */
function forget(): void {
  waiting.value = false
  checking.value = false
  s.checked.value = null
}

function changed(points: Point[], choose: number | null): void {
  waiting.value = false
  draft.value = points
  chosen.value = choose
  check()
}

/** Have the robot check the draft, at a limited rate. */
function check(): void {
  clearTimeout(later)
  const wait = checkedAt + CHECK_EVERY_MS - performance.now()
  if (wait > 0) {
    later = setTimeout(check, wait)
    return
  }
  if (draft.value.length === 0) return
  checkedAt = performance.now()
  propose(true)
}

/** Send the draft, in millimetres: so a message has room for all of it. */
function propose(only_check: boolean): boolean {
  checking.value = only_check
  if (draft.value.length > MOST) {
    checking.value = true
    s.checked.value = { type: 'checked', ok: false, only_check: true, why: `more than ${MOST} waypoints: leave some out`, worst: null }
    return false
  }
  const round = (value: number) => Math.round(clamp(value, -FARTHEST, FARTHEST) * 1000) / 1000
  const points = draft.value.map(([x, y]): Point => [round(x), round(y)])
  return send({ type: 'waypoints', points, only_check })
}

/** Add one after the selected one, or at the end. */
export function add(point: Point): void {
  const at = chosen.value === null ? draft.value.length : chosen.value + 1
  changed([...draft.value.slice(0, at), point, ...draft.value.slice(at)], at)
}

export function move(i: number, point: Point): void {
  changed(draft.value.map((p, k) => (k === i ? point : p)), i)
}

export function remove(i: number): void {
  const left = draft.value.filter((_, k) => k !== i)
  changed(left, left.length === 0 ? null : Math.min(i, left.length - 1))
}

export function submit(): void {
  clearTimeout(later)
  s.checked.value = null
  sent = draft.value
  waiting.value = propose(false)
}

/** The waypoint waypointAt a pixel, or null. */
export function waypointAt(at: Point, pixels: Point[]): number | null {
  let best: number | null = null
  let least = 16
  for (const [i, p] of pixels.entries()) {
    const d = Math.hypot(p[0] - at[0], p[1] - at[1])
    if (d < least) {
      least = d
      best = i
    }
  }
  return best
}
