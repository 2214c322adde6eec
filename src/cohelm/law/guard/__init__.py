"""The guard: the bounded, footprint-exact, certified filter from nominal command to wheels.

`contact` where the outline is nearest to something; `bounds` what the wheels can do in one
step; `project` the least change of the nominal command; `certify` whether the robot can still stop
clear of everything; `step` the four in order.
"""
