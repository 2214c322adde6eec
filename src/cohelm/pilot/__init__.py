"""One pilot: where to go, how fast, who leads, what is let through, and the way round.

`step` is the fast part, once per control step: a reference that waits, track, blend, filter.
`replanning` is the slow one, a few times a second: ways round, rejoining, backing out; `rollout`
foretells the drive for it. `delay_compensation` is the moment at which a command takes effect,
`obstacles_from_perception` what both parts know of what is seen, `margin_inflation` the room for
what that is off by. For a caller in Python, `pilot` has both parts, `safety_filter` the filter
alone.
"""
