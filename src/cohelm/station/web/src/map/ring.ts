// Clearance by direction: one number for each sector around the robot. Pure.
import type { Pose } from '../binary'
import { toBody, type Point } from './view'

export const SECTORS = 24

/** Distance from the origin of the body to its outline, looking along `bearing` [m]. */
export function reach(outline: Point[], bearing: number): number {
  const c = Math.cos(bearing)
  const s = Math.sin(bearing)
  let least = Infinity
  for (let i = 0; i < outline.length; i++) {
    const a = outline[i]
    const b = outline[(i + 1) % outline.length]
    if (a === undefined || b === undefined) continue
    const ex = b[0] - a[0]
    const ey = b[1] - a[1]
    const det = ex * s - ey * c
    if (Math.abs(det) < 1e-12) continue
    const t = (ex * a[1] - ey * a[0]) / det
    const along = (c * a[1] - s * a[0]) / det
    if (t > 0 && along >= -1e-9 && along <= 1 + 1e-9) least = Math.min(least, t)
  }
  return Number.isFinite(least) ? least : 0
}

/** Clearance from the outline to the nearest obstacle in each sector; sector 0 is ahead,
 * counter-clockwise [m]. */
export function clearances(
  pose: Pose, outline: Point[], seen: Float64Array, discs: Array<[number, number, number]>,
): number[] {
  const out = new Array<number>(SECTORS).fill(Infinity)
  const width = (2 * Math.PI) / SECTORS
  const near = (px: number, py: number, radius: number) => {
    const [x, y] = toBody(pose, [px, py])
    const bearing = Math.atan2(y, x)
    const clearance = Math.max(Math.hypot(x, y) - radius - reach(outline, bearing), 0)
    const sector = ((Math.round(bearing / width) % SECTORS) + SECTORS) % SECTORS
    out[sector] = Math.min(out[sector] ?? Infinity, clearance)
  }
  for (let i = 0; i + 1 < seen.length; i += 2) near(seen[i] ?? 0, seen[i + 1] ?? 0, 0)
  for (const [x, y, radius] of discs) near(x, y, radius)
  return out
}

