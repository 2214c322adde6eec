"""The one place where time passes on the robot: read, perceive, step, gate, send, record.

`loop` one period after the other; `senses` whether what was read may be relied on; `person` whether
the stick may; `timing` how well time is kept; `planning` the slow part, elsewhere; `telling` what
the operator is told.
"""
