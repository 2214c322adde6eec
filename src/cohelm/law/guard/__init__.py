"""The guard: the bounded, footprint-exact, certified filter from nominal command to wheels.

`contact` finds the nearest point of the outline, `bounds` and `approach` the velocity bounds,
`project` the least change of the nominal command within them, `certify` whether the robot can still
stop clear of everything; `step` runs them in order.
"""
