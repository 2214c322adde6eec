"""The guard: the bounded, footprint-exact, certified filter between any wish and the wheels.

`contact` where the outline is nearest to something; `bounds` what the wheels can do in one
step; `project` the least change of the wish; `certify` whether the robot can still stop clear of
everything; `step` the four in order.
"""
