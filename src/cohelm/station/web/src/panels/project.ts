// Projects a floor point to a pixel of the camera. Pure.
import type { Camera } from '../messages'

/** Pixel of a floor point in the body frame (x forward, y left) [m]; null behind the camera. */
export function project(
  lens: Camera, size: { width: number; height: number }, [x, y]: [number, number],
): [number, number] | null {
  const forward = x - lens.mount_x_m
  const c = Math.cos(lens.tilt_rad)
  const s = Math.sin(lens.tilt_rad)
  const depth = forward * c + lens.mount_z_m * s
  if (depth < 0.05) return null
  const down = lens.mount_z_m * c - forward * s
  const focal = size.height / 2 / Math.tan(lens.field_of_view_rad / 2)
  return [size.width / 2 - (focal * y) / depth, size.height / 2 + (focal * down) / depth]
}
