"""The last word before the wheels: it refuses what must not reach them, and says why.

It shares no code with the law and works when the law is wrong. `modes` whom the robot listens to;
`bounds` what the wheels may be asked for; `gate` both together, with the watchdog.
"""
