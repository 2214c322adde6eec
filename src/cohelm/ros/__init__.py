"""ROS 2 without ROS: its topics over a transport, a robot behind them, the safety filter as a node.

`port` is what a transport must do: `dds`, `foxglove` and `zenoh`. `look` finds out what a robot
offers, `robot` puts it behind the robot port, `filter_node` stands between any controller and the
base; `localized` publishes the pose on the map, `goals` receives goals and paths.
"""
