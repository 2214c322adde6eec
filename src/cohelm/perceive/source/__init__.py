"""The memory of one sensor each: LiDAR, range sensor (sonar, infrared), bumper or cliff sensor."""
