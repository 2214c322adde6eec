"""From scans and odometry to what the robot knows: its place, obstacles, who moves, maps.

`pipeline` is the door. `scan` puts one scan right; `match` lays scans on surfaces; `localize` finds
the robot on a map; `track` follows who moves; `space` remembers ground that was seen, or was not;
`map` makes maps from drives.
"""
