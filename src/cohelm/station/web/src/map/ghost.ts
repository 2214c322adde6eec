// The predicted pose when the operator's present command reaches the robot. Pure.
import type { Pose } from '../binary'
import type { Status } from '../messages'

/** `pose` after `t` seconds of a constant twist: an exact arc. */
export function arc(pose: Pose, [v, omega]: [number, number], t: number): Pose {
  const [x, y, psi] = pose
  const turned = omega * t
  if (Math.abs(turned) < 1e-6) {
    return [x + v * t * Math.cos(psi), y + v * t * Math.sin(psi), psi + turned]
  }
  const r = v / omega
  return [
    x + r * (Math.sin(psi + turned) - Math.sin(psi)),
    y - r * (Math.cos(psi + turned) - Math.cos(psi)),
    psi + turned,
  ]
}

/** The pose `delay` seconds after the state, along the robot's predicted path if there is one. */
export function ghost({ pose, applied, ahead: path, ahead_step }: Status, delay: number): Pose | null {
  if (pose === null || applied === null) return null
  if (path.length < 2 || ahead_step === null || ahead_step <= 0) return arc(pose, applied, delay)
  // point 0 is the present position or one step ahead of it
  const at = Math.min(delay / ahead_step, path.length - 1)
  const i = Math.min(Math.floor(at), path.length - 2)
  const [a, b] = [path[i], path[i + 1]]
  if (a === undefined || b === undefined) return pose
  const share = at - i
  const heading = arc(pose, applied, delay)[2]
  return [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), heading]
}
