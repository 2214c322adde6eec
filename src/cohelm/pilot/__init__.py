"""One pilot: where to go, how fast, who leads, what is let through, and the way round.

`step` the fast part, once per control step: a reference that waits, track, blend, filter;
`evasion` making way for who moves; `foresee` the moment at which a command takes effect; `course`
what is followed, and its speeds;
`plan` the slow part, a few times a second: ways round, rejoining, backing out; `movers` what it
makes of things that move; `told` what both know of what is seen, and `careful` the room for what
that is off by; `pilot` both for a caller in Python.
"""
