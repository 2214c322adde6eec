"""Ground near the robot: seen free, remembered, or not observed."""
