"""From scans and odometry to what the robot knows: its place, obstacles, who moves, maps.

`pipeline` is the entry point. `scan` deskews, filters and clusters one scan; `match` matches scans
to surfaces; `source` is the memory of one sensor; `localize` finds the robot on a map; `track`
follows what moves; `space` remembers free and unobserved ground; `map` makes maps from drives.
"""
