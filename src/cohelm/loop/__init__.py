"""The one place where time passes on the robot: read, perceive, step, gate, send, record.

`loop` is one period after the other. `sensor_watchdog` decides whether readings may be relied on,
`stick_arming` whether the stick may, `authorization` whose request counts; `driver` makes the
command, `latency_limit` slows it for an operator who is far away; `planning` runs the slow part
elsewhere. `timing` measures how well time is kept; `alarms` and `status` are for the operator.
"""
