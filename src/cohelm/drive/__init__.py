"""Where both ends are put together: robot, loop, link, record and station."""
