"""What was measured, to look at: how the robot answered, and how well the scans fit."""

# matplotlib's methods take untyped **kwargs; everything of ours is still checked.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from cohelm.calibrate.mount import MeasuredMount
from cohelm.calibrate.response import Response
from cohelm.calibrate.ride import Ride


def pictures(
    folder: Path, ride: Ride, response: Response, mount: MeasuredMount | None
) -> list[Path]:
    """Write response.png, and scans.png where the scans could be used."""
    commands = np.array(ride.commands)
    figure = Figure(figsize=(11.0, 6.5), layout="constrained")
    for row, (channel, unit, straight) in enumerate(
        ((response.straight, "m/s", True), (response.turn, "rad/s", False))
    ):
        last = [s for s in ride.segments if (s[2].twist.v != 0.0) == straight][-8:]
        some = [s for s in last if s[2].hard][-1:] + [s for s in last if not s[2].hard][-1:]
        for column, (start, ended, segment) in enumerate(some):
            axes = figure.add_subplot(2, 2, 2 * row + column + 1)
            at = (channel.times > start - 0.1) & (channel.times < ended + 0.3)
            sent = (commands[:, 0] > start - 0.1) & (commands[:, 0] < ended + 0.3)
            axes.step(commands[sent, 0] - start, commands[sent, 1 if straight else 2],
                      where="post", color="#777777", label="commanded")  # fmt: skip
            axes.plot(channel.times[at] - start, channel.seen[at], ".", color="#0072B2",
                      label="odometry")  # fmt: skip
            axes.plot(channel.times[at] - start, channel.fitted[at], color="#D55E00",
                      label="delay, ramp and lag fitted")  # fmt: skip
            how = "ended by stop" if segment.hard else "ended by the gate's ramp"
            axes.set_title(f"{'straight' if straight else 'turn'}, {how}")
            axes.set_xlabel("s")
            axes.set_ylabel(unit)
            axes.legend()
    files = [folder / "response.png", folder / "scans.png"]
    figure.savefig(files[0], dpi=110, metadata={"Software": None})
    if mount is None:
        files[1].unlink(missing_ok=True)  # of a run before
        return files[:1]
    figure = Figure(figsize=(9.0, 4.0), layout="constrained")
    axes = figure.add_subplot()
    axes.plot(1e3 * mount.residuals[:, 0], "o", color="#0072B2", label="ahead [mm]")
    axes.plot(1e3 * mount.residuals[:, 1], "s", color="#009E73", label="left [mm]")
    axes.plot(
        np.degrees(mount.residuals[:, 2]) * 10.0, "^", color="#D55E00", label="heading [0.1 deg]"
    )
    axes.axhline(0.0, color="#777777", lw=0.8)
    axes.set_title("Matched scans from what mount and scales foretell, motion by motion")
    axes.set_xlabel("motion")
    axes.legend()
    figure.savefig(files[1], dpi=110, metadata={"Software": None})
    return files
