"""What connects the person to the robot: sticks, recorded and live."""
