"""Where both ends are put together: robot, gate, loop, record, and who sits at the stick.

`simulated` the robot of a scenario; `recorder` the record, in a process of its own; `session` all
of it, started and ended in the right order; `operate` from the command line to a session; `served`
a session driven over the link, `desk` what is asked of it beside driving; `beside` all that in a
process beside the station's; `film` shows a record again.
"""
