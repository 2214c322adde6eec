"""The collision monitor: protective fields on the raw scan, in the gate process.

Like safety scanners (IEC 61496-3, ISO 13855) and Nav2's collision monitor. It shares no code with
perception, filter or the robot's kinematics. `returns`: positions and errors of a scan's returns;
`surroundings`: those, and remembered ones out of view; `free_space`: ground that was never in view;
`source`: all this of one LiDAR; `odometry`: past poses; `sweep`: time to contact of an outline on
an arc; `fields`: the allowed share of a motion; `runaway`: uncommanded motion; `monitor`: all.
"""
