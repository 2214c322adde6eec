// Merges the robot's alarms that have the same text.
import type { Alarm } from '../messages'

export interface ShownAlarm extends Alarm {
  /** Numbers of all alarms with this text. */
  all: number[]
  /** The page's, and not the robot's: it is not acknowledged. */
  local: boolean
}

/** A merged alarm is active if one of them is, and acknowledged if all are. */
export function mergeAlarms(alarms: Alarm[]): ShownAlarm[] {
  const out: ShownAlarm[] = []
  for (const a of alarms) {
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
