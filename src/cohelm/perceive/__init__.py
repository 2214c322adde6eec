"""From what the LiDAR sees to what the robot knows: points, clearance, and a way through."""
