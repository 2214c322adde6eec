// The map's view: map frame [m] to canvas pixels and back. Pure.
import type { Pose } from '../binary'

export interface View {
  /** World point in the middle of the canvas [m]. */
  x: number
  y: number
  /** Pixels for a metre. */
  scale: number
}

export interface Size {
  width: number
  height: number
}

export type Point = [number, number]

const LEAST = 2
const MOST = 400

export function toPixel(v: View, s: Size, [x, y]: Point): Point {
  return [s.width / 2 + (x - v.x) * v.scale, s.height / 2 - (y - v.y) * v.scale]
}

export function toWorld(v: View, s: Size, [px, py]: Point): Point {
  return [v.x + (px - s.width / 2) / v.scale, v.y - (py - s.height / 2) / v.scale]
}

/** Zoomed in by `factor`; the map point under the pixel stays where it is. */
export function zoomed(v: View, s: Size, at: Point, factor: number): View {
  const scale = Math.min(Math.max(v.scale * factor, LEAST), MOST)
  const [x, y] = toWorld(v, s, at)
  return {
    x: x - (at[0] - s.width / 2) / scale,
    y: y + (at[1] - s.height / 2) / scale,
    scale,
  }
}

export function moved(v: View, dx: number, dy: number): View {
  return { ...v, x: v.x - dx / v.scale, y: v.y + dy / v.scale }
}

/** A view that contains all points, with a margin. */
export function viewOf(points: Point[], s: Size): View | null {
  if (points.length === 0 || s.width === 0) return null
  const xs = points.map((p) => p[0])
  const ys = points.map((p) => p[1])
  const [x1, x2] = [Math.min(...xs), Math.max(...xs)]
  const [y1, y2] = [Math.min(...ys), Math.max(...ys)]
  const scale = Math.min(s.width / (x2 - x1 + 3), s.height / (y2 - y1 + 3))
  return { x: (x1 + x2) / 2, y: (y1 + y2) / 2, scale: Math.min(Math.max(scale, LEAST), MOST) }
}

/** A point from the body frame to the map frame. */
export function fromBody(pose: Pose, [x, y]: Point): Point {
  const c = Math.cos(pose[2])
  const s = Math.sin(pose[2])
  return [pose[0] + c * x - s * y, pose[1] + s * x + c * y]
}

/** A point from the map frame to the body frame. */
export function toBody(pose: Pose, [x, y]: Point): Point {
  const c = Math.cos(pose[2])
  const s = Math.sin(pose[2])
  const dx = x - pose[0]
  const dy = y - pose[1]
  return [c * dx + s * dy, -s * dx + c * dy]
}

/** Waypoints to the start of a dock's approach, reached along the dock's axis. */
export function routeTo({ pose, approach }: { pose: Pose | null; approach: number | null }): Point[] {
  if (pose === null || approach === null) return []
  return [0.7, 0].map((before) => fromBody(pose, [-approach - before, 0]))
}
