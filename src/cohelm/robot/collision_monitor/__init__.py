"""The second layer: protective fields on the raw scan, in the gate process.

What safety scanners (IEC 61496-3, ISO 13855) and Nav2's collision monitor are. It shares no code
with perception, filter or the robot's kinematics. `returns` where a scan's returns are and how
surely, `surroundings` those and what went out of sight, `free_space` ground that was never in
view, `source` all this of one LiDAR, `odometry` where the robot was when, `sweep` when an outline
on an arc meets a point, `fields` how much of a motion the room ahead allows, `runaway` motion that
nobody commands, `monitor` all of it.
"""
