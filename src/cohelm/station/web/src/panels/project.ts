// Projects a floor point to a pixel of the camera. Pure.
import type { Hello } from '../messages'

export type Lens = NonNullable<Hello['camera']>

/** Pixel of a floor point in the body frame (x forward, y left) [m]; null behind the camera. */
export function project(
  [fieldOfView, mountX, mountZ, tilt]: Lens, size: { width: number; height: number }, [x, y]: [number, number],
): [number, number] | null {
  const forward = x - mountX
  const c = Math.cos(tilt)
  const s = Math.sin(tilt)
  const depth = forward * c + mountZ * s
  if (depth < 0.05) return null
  const down = mountZ * c - forward * s
  const focal = size.height / 2 / Math.tan(fieldOfView / 2)
  return [size.width / 2 - (focal * y) / depth, size.height / 2 + (focal * down) / depth]
}
