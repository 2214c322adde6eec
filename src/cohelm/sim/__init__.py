"""Worlds that play the robot: exact kinematics, moving obstacles, a simulated person."""
