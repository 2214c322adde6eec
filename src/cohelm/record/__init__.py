"""Records of runs as MCAP files: written as the run goes, viewed in Foxglove, read back exactly."""
