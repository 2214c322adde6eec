// The robot's past path, as far as this page received it.
import { effect, signal } from '@preact/signals'
import * as s from '../state'
import type { Point } from './view'

const STEP_M = 0.05
const MOST = 5000

export const trail = signal<Point[]>([])

effect(() => {
  const pose = s.state.value?.pose ?? null
  if (pose === null) return
  const before = trail.peek()
  const last = before.at(-1)
  const here: Point = [pose[0], pose[1]]
  const far = last === undefined ? Infinity : Math.hypot(here[0] - last[0], here[1] - last[1])
  if (far < STEP_M) return
  // a jump is not a path: the replay was moved, or the robot relocalized
  trail.value = far > 2 && last !== undefined ? [here] : [...before.slice(1 - MOST), here]
})
