"""Perception: from scans and odometry to pose, obstacles, movers and maps.

`pipeline` is the entry point. `scan` deskews, filters and clusters one scan; `match` matches scans
to surfaces; `source` is the memory of one sensor; `localize` localizes the robot on a map; `track`
tracks movers; `space` remembers points, free and unobserved space; `map` makes maps from drives.
"""
