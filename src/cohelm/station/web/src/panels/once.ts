// The robot's alarms; what says the same, for two reasons, is said once.
import type { Alarm } from '../messages'

export interface Shown extends Alarm {
  /** Numbers of all alarms that say the same. */
  all: number[]
  /** Ours, and not the robot's: it goes away by itself. */
  local: boolean
}

/** Over is what is over for every reason, and so is what was seen. */
export function once(told: Alarm[]): Shown[] {
  const out: Shown[] = []
  for (const a of told) {
    const same = out.find((b) => b.text === a.text && b.severity === a.severity)
    if (same === undefined) out.push({ ...a, local: false, all: [a.number] })
    else {
      same.all.push(a.number)
      same.active = same.active || a.active
      same.acknowledged = same.acknowledged && a.acknowledged
    }
  }
  return out
}
