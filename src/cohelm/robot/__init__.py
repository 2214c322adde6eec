"""The robot: outline, wheels, limits and sensors, the port to it, its gate and its monitors."""
