"""Checks that the robot's sensors agree: with themselves, each other and the commands sent.

Independent of perception: in the gate process, on raw readings, with code of its own.
"""
