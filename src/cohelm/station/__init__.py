"""The operator's station: a web server between the robot's link and the pages in `web/`."""
