"""The one place where time passes on the robot: read, perceive, step, gate, send, record.

`loop` is one period after the other. `sensor_watchdog` decides whether readings may be relied on;
`supervisor` who drives and in which mode, with `stick` for whether the stick is believed
and `authorization` for whose request counts. `driver` makes the command, `speed_caps` slows it
for an operator who is far away; `planning` runs the slow part elsewhere. `timing` measures how well
time is kept; `status`, with `alarms`, tells recorder and operator.
"""
