"""One scan: deskewed, without stray ranges, in clusters; the odometry that goes with it."""
