"""The one place where time passes on the robot: read, perceive, step, gate, send, record.

`loop` one period after the other; `senses` whether what was read may be relied on; `person` whether
the stick may; `driver` what to ask of the wheels; `leash` how fast for whom is far away; `planning`
the slow part, elsewhere; `timing` how well time is kept; `alarms` and `telling` what the operator
is told.
"""
