"""One scan: deskewing, range filter, clustering; and the odometry buffer."""
