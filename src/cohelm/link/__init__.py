"""What connects the operator to the robot: the link over the network, and sticks.

`robot_end` and `station_end` are the two ends, `robot_bulk` and `station_bulk` what is large;
`messages` says what they tell each other, `wire` how in bytes, `keys` who may; `operator` is the
port of the robot's loop. `sticks` are devices on the station's host, `stick` one from a file.
"""
