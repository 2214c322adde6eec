"""Whether the robot's senses agree: with themselves, with each other, with what it was told to do.

Apart from perception, in the gate process, on raw readings, with code of its own.
"""
