"""Where both ends are put together: robot, gate, loop, record, and who sits at the stick.

`simulated` the robot of a scenario; `recorder` the record, in a process of its own; `session` all
of it, started and ended in the right order; `operate` from the command line to a session; `film`
shows a record again.
"""
