// Dead band and expo curve of a raw deflection. Pure, so that it can be tested.

export interface Shape {
  /** Deflections up to this are none, [0, 0.5]. */
  deadBand: number
  /** 0 straight .. 1 cubic: fine near the centre. */
  curve: number
}

export function clamp(value: number, low: number, high: number): number {
  return Math.min(Math.max(value, low), high)
}

/** Odd, continuous, 0 inside the dead band, ±1 at the ends. NaN stays NaN. */
export function shaped(raw: number, { deadBand, curve }: Shape): number {
  const size = clamp(Math.abs(raw), 0, 1)
  if (size <= deadBand) return 0
  const x = (size - deadBand) / (1 - deadBand)
  const y = (1 - curve) * x + curve * x * x * x
  return raw < 0 ? -y : y
}

/** `from` moved towards `to` by at most `step`. */
export function towards(from: number, to: number, step: number): number {
  return from + clamp(to - from, -step, step)
}
