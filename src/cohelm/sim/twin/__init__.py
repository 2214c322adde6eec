"""The physics twin: the robot and its world in MuJoCo, behind the same port as the others."""
