"""Options in the sentences about a ROS 2 robot, as the command has them that is used."""

from __future__ import annotations

_OF_THE_FILTER = {
    "--further-scan ": "--topic scan_",
    "--scan": "--topic scan=TOPIC",
    "--contact ": "--topic contact_",
    "--odom": "--topic odom=TOPIC",
    "--out": "--topic out=TOPIC",
    "with --footprint": "with --topic footprint=TOPIC",
    "with --lock, or none with --lock ''": "with --topic lock=TOPIC",
    "is it that (--lock)?": "is it that (--topic lock=TOPIC)?",
    "remap that to the topic of --in, or allow it with --allow-bypass and expect no promise":
        "end that",
    "say which is the base's with --stamped or --unstamped": "let the base want one of them",
    ", or allow it with --clock-difference": "",
    ", or give lidar.mount_x_m, mount_y_m and mount_yaw_deg in the robot's YAML file and "
    "--mount-from-model": "",
}  # fmt: skip


def by_topics(text: str) -> str:
    """What does not fit, with the options that a robot's commands have: `--topic KEY=NAME`, where
    `cohelm filter` has one for each."""
    for one, instead in _OF_THE_FILTER.items():
        text = text.replace(one, instead)
    return text
