// The LiDARs' scans as points in the map. Pure.
import type { Scan } from '../binary'

const NO_RETURN = 65535

/** A scan that is older than the newest by more than this is not shown [ms]. */
const SILENT_MS = 1500

/** Beams of the newest scan of each LiDAR as points in the map, without those of no return or too near. */
export function points(scans: Scan[]): Float64Array {
  const newest = Math.max(...scans.map((scan) => scan.at))
  const recent = scans.filter((scan) => newest - scan.at < SILENT_MS)
  const out = new Float64Array(2 * recent.reduce((sum, scan) => sum + scan.ranges.length, 0))
  let k = 0
  for (const scan of recent) {
    const [x, y, psi] = scan.sensor
    for (let i = 0; i < scan.ranges.length; i++) {
      const mm = scan.ranges[i]
      if (mm === undefined || mm === 0 || mm === NO_RETURN) continue
      const bearing = psi + scan.first + i * scan.step
      out[k++] = x + (mm / 1000) * Math.cos(bearing)
      out[k++] = y + (mm / 1000) * Math.sin(bearing)
    }
  }
  return out.subarray(0, k)
}
