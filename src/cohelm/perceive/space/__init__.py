"""Memory of the ground near the robot: static points, free and unobserved space."""
