"""What a robot is: shape, wheels, limits and sensors, the port to it, and who keeps its wheels."""
