"""Options in the sentences about a ROS 2 robot, as the command has them that is used."""

from __future__ import annotations

from typing import NamedTuple


class OptionNames(NamedTuple):
    """By which a user states what does not fit; by default those of `cohelm filter`."""

    odom: str = "--odom"
    scan: str = "--scan"
    further_scan: str = "--further-scan "
    """Before the name of a further LiDAR."""
    contact: str = "--contact "
    """Before the name of a contact sensor."""
    out: str = "--out"
    footprint: str = "--footprint"
    lock: str = "--lock"
    no_lock: str = ", or none with --lock ''"
    bypass: str = (
        "remap that to the topic of --in, or allow it with --allow-bypass and expect no promise"
    )
    """What to do with another node that commands the base."""
    stamped: str = "say which is the base's with --stamped or --unstamped"
    clock: str = ", or allow it with --clock-difference"
    mount: str = (
        ", or give lidar.mount_x_m, mount_y_m and mount_yaw_deg in the robot's YAML file and "
        "--mount-from-model"
    )


FILTER = OptionNames()
ROBOT = OptionNames(
    odom="--topic odom=TOPIC", scan="--topic scan=TOPIC", further_scan="--topic scan_",
    contact="--topic contact_", out="--topic out=TOPIC", footprint="--topic footprint=TOPIC",
    lock="--topic lock=TOPIC", no_lock="", bypass="end that",
    stamped="let the base want one of them", clock="", mount="",
)  # fmt: skip
"""Of the commands that drive a robot: they have `--topic KEY=NAME`."""
