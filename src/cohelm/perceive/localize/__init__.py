"""Where the robot is on a map, and that it is lost; what a map is for that."""
