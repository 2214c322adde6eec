"""Compares the assumptions of a robot's model with what was measured: are they safe?"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from cohelm.calibrate.mount import MeasuredMount
from cohelm.calibrate.response import Measured, Response
from cohelm.core.errors import CohelmError
from cohelm.robot.model import LONGEST_DELAY, RobotModel

Verdict = Literal["safe", "unsafe", "unsure", "wasteful"]
_WASTE = 0.15  # an assumption that gives away more than this share is wasteful
_DELAY = 0.02  # ... or so much time [s]
_ALMOST = 0.97  # of a limit: it is reached
_SURE = 0.9  # of a limit: it must not be less by the low end of its interval
_AGAIN = "drive it again, with more --floor"
_PLACE, _TURN = 0.01, math.radians(0.5)  # a mount is well enough known within this [m, rad]
_WHEEL = 0.01  # and a wheel or track within this share
_EXACT = Measured(1.0, 0.0)


class Comparison(NamedTuple):
    """One key of the robot's file."""

    key: str
    """As in its YAML file, `limits.speed_mps`."""
    assumed: float | None
    measured: Measured
    write: float
    """What to assume from now on: on the safe side of the interval."""
    verdict: Verdict
    why: str
    """In a sentence."""


def findings(
    model: RobotModel, response: Response, mount: MeasuredMount | None, added: float = 0.0
) -> list[Comparison]:
    """Of a run. No limit is written larger than it was assumed.

    mount: None where the scans could not be used: then the odometry's own metres and radians count,
    and wheels, track and LiDAR are left as they are. added: what the loop adds to the file's
    `delay_s` by itself, for the drives of a simulated twin [s].
    """
    straight, turn = response.straight, response.turn
    way, heading = (mount.way, mount.heading) if mount is not None else (_EXACT, _EXACT)
    track = model.track_m if mount is None else _track(model, response, mount).value
    found = [_delay(model.delay_s, response.total, added)]
    rise = _times(straight.rise, way), _times(turn.rise, heading)
    brake = _times(straight.brake, way), _times(turn.brake, heading)
    given = model.limits
    if given.wheel_acceleration_mps2 is not None:
        rim = Measured(0.5 * track, 0.0)
        found.append(_limit(
            "limits.wheel_acceleration_mps2", given.wheel_acceleration_mps2,
            min(rise[0], _times(rise[1], rim)), min(brake[0], _times(brake[1], rim)),
        ))  # fmt: skip
    if given.acceleration_mps2 is not None or given.wheel_acceleration_mps2 is None:
        found.append(_limit("limits.acceleration_mps2", given.acceleration_mps2, rise[0], brake[0]))
    if given.yaw_acceleration_radps2 is not None or given.wheel_acceleration_mps2 is None:
        found.append(_limit(
            "limits.yaw_acceleration_radps2", given.yaw_acceleration_radps2, rise[1], brake[1]
        ))  # fmt: skip
    for key, assumed, channel, factor in (
        ("limits.speed_mps", given.speed_mps, straight, way.value),
        ("limits.yaw_rate_radps", given.yaw_rate_radps, turn, heading.value),
    ):
        if assumed is not None and channel.commanded > 0.98 * assumed:
            found.append(_speed(key, assumed, channel.speed * factor))
    if mount is None:
        return found
    radius = _times(way, Measured(model.wheel_radius_m, 0.0))
    found.append(_exact("wheel_radius_m", model.wheel_radius_m, radius,
                        _WHEEL * model.wheel_radius_m, "m"))  # fmt: skip
    found.append(_exact("track_m", model.track_m, _track(model, response, mount),
                        _WHEEL * model.track_m, "m"))  # fmt: skip
    if model.lidar is not None:
        lidar = model.lidar
        yaw = Measured(math.degrees(mount.yaw.value), math.degrees(mount.yaw.off))
        found += [
            _exact("lidar.mount_x_m", lidar.mount_x_m, mount.x, _PLACE, "m"),
            _exact("lidar.mount_y_m", lidar.mount_y_m, mount.y, _PLACE, "m"),
            _exact("lidar.mount_yaw_deg", lidar.mount_yaw_deg, yaw, math.degrees(_TURN), "deg"),
            _noise(lidar.noise_m, mount.noise),
        ]
    return found


def _track(model: RobotModel, response: Response, mount: MeasuredMount) -> Measured:
    """Distance that the wheels roll for a metre and for a radian that are commanded [m].

    Commanded and not by the odometry, whose heading may be a gyro's and independent of the track.
    """
    parts = (mount.way, response.straight.gain, mount.heading, response.turn.gain)
    way, straight, heading, turn = (part.value for part in parts)
    track = model.track_m * (way * straight) / (heading * turn)
    return Measured(track, track * math.hypot(*(part.off / part.value for part in parts)))


def odometry_noise(model: RobotModel, response: Response) -> dict[str, float]:
    """The odometry's scatter, as the robot's file has it: only simulated robots use it."""
    way = max(response.straight.speed / model.odometry.rate_hz, 1e-6)  # between two readings
    turn = response.turn.noise * model.odometry.rate_hz
    return {
        "odometry.slip": response.straight.noise * math.sqrt(2.0 / way),
        "odometry.gyro_noise_degps": math.degrees(turn),
    }


def earlier_run(file: Path, robot: str) -> tuple[list[Comparison], dict[str, float]]:
    """The findings, and the odometry's scatter, of the run before without a load, as its JSON file
    has them.

    Raises CohelmError where there is none, or it is of another robot.
    """
    try:
        read: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        robot_then = read["robot"]
        found = [
            Comparison(
                key, None if one["assumed"] is None else float(one["assumed"]),
                Measured(float(one["measured"]), float(one["off"])), float(one["write"]),
                one["verdict"], str(one["why"]),
            )
            for key, one in read["findings"].items()
        ]  # fmt: skip
        odometry = {str(key): float(value) for key, value in read["odometry"].items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise CohelmError(f"--load needs a run without it first: {file} is none") from error
    if robot_then != robot:
        raise CohelmError(f"{file} is of {robot_then}, not of {robot}: give another --out")
    return found, odometry


def whole_run(file: Path) -> str:
    """The robot that was measured in a run that came to its end; empty: the file holds none."""
    try:
        read: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        return str(read["robot"]) if read["whole"] else ""
    except (OSError, ValueError, KeyError, TypeError):
        return ""


def with_load(found: list[Comparison], earlier: list[Comparison]) -> list[Comparison]:
    """The worse of two runs for what a load changes; the rest is of the run without it."""
    loaded = {one.key: one for one in found}
    made: list[Comparison] = []
    for was in earlier:
        now = loaded.pop(was.key, was)
        if was.key == "delay_s":
            made.append(max(now, was, key=lambda f: f.write))
        elif was.key.startswith("limits."):
            made.append(min(now, was, key=lambda f: f.write))
        else:
            made.append(was)
    return made + list(loaded.values())


def as_dict(found: list[Comparison]) -> dict[str, Any]:
    """By key, for JSON."""
    return {
        one.key: {
            "assumed": one.assumed, "measured": one.measured.value, "off": one.measured.off,
            "write": one.write, "verdict": one.verdict, "why": one.why,
        }
        for one in found
    }  # fmt: skip


def _delay(assumed: float, total: Measured, added: float) -> Comparison:
    seen = Measured(total.value - added, total.off)
    # the end of the interval, as of a limit: what obeys later than predicted stops farther on
    write = min(max(math.ceil(1e3 * (seen.value + seen.off) - 1e-6) / 1e3, 0.0), LONGEST_DELAY)
    if seen.value - seen.off > assumed:
        return Comparison("delay_s", assumed, seen, write, "unsafe",
                       f"it obeys {1e3 * (seen.value - assumed):.0f} ms later: it stops farther on "
                       "than predicted")  # fmt: skip
    if seen.value + seen.off < assumed - _DELAY:
        return Comparison("delay_s", assumed, seen, write, "wasteful",
                       "it obeys earlier: it keeps away farther than it has to")  # fmt: skip
    if (late := seen.value + seen.off - assumed) > _DELAY:
        return Comparison("delay_s", assumed, seen, write, "unsure",
                       f"it may obey {1e3 * late:.0f} ms later: {_AGAIN}")  # fmt: skip
    return Comparison("delay_s", assumed, seen, assumed, "safe", "it obeys as predicted")


def _times(a: Measured, b: Measured) -> Measured:
    return Measured(a.value * b.value, math.hypot(a.off * b.value, a.value * b.off))


def _limit(key: str, assumed: float | None, rise: Measured, brake: Measured) -> Comparison:
    least = min(rise, brake)
    sure = _down(max(least.value - least.off, 0.5 * least.value))
    if assumed is None:
        return Comparison(key, None, least, sure, "unsafe", "no end of it is assumed")
    if least.value + least.off < _ALMOST * assumed:
        why = ("it can not stop where the guard counts on it" if least is brake
               else "it gains speed more slowly than the guard counts on")  # fmt: skip
        return Comparison(key, assumed, least, min(sure, assumed), "unsafe", why)
    if least.value - least.off < _SURE * assumed:
        sure = min(sure, assumed)
        return Comparison(key, assumed, least, sure, "unsure", f"it may be only {sure:g}: {_AGAIN}")
    if brake.value - brake.off > (1.0 + _WASTE) * assumed:
        return Comparison(key, assumed, brake, assumed, "wasteful", "it can brake harder")
    return Comparison(key, assumed, brake, assumed, "safe", "it does what is assumed")


def _speed(key: str, assumed: float, seen: float) -> Comparison:
    measured = Measured(seen, 0.01 * seen)
    if seen < _ALMOST * assumed:
        return Comparison(key, assumed, measured, _down(seen), "unsafe", "it is not reached")
    if seen > 1.03 * assumed:
        return Comparison(
            key, assumed, measured, assumed, "unsafe",
            "it is faster than commanded: correct wheel_radius_m or track_m in its base",
        )  # fmt: skip
    return Comparison(key, assumed, measured, assumed, "safe", "it is reached, and held")


def _exact(key: str, assumed: float, seen: Measured, room: float, unit: str) -> Comparison:
    off = seen.value - assumed
    if abs(off) > room + seen.off:
        return Comparison(
            key, assumed, seen, round(seen.value, 4), "unsafe", f"it is {off:+.3g} {unit} off"
        )
    if seen.off > 2.0 * room:  # neither side of it is the safe one
        why = f"it is known within {seen.off:.2g} {unit} only: {_AGAIN}"
        return Comparison(key, assumed, seen, assumed, "unsure", why)
    return Comparison(key, assumed, seen, assumed, "safe", "it is as assumed")


def _noise(assumed: float, seen: float) -> Comparison:
    measured = Measured(seen, 0.1 * seen)
    if seen > 1.2 * assumed + 1e-3:
        return Comparison("lidar.noise_m", assumed, measured, round(seen, 4), "unsafe",
                       "the ranges scatter more: less is kept free than is needed")  # fmt: skip
    if seen < 0.5 * assumed:
        return Comparison(
            "lidar.noise_m", assumed, measured, assumed, "wasteful", "they scatter less"
        )
    return Comparison("lidar.noise_m", assumed, measured, assumed, "safe", "they scatter no more")


def _down(value: float) -> float:
    """Three digits, never more than the value."""
    digits = 2 - math.floor(math.log10(max(value, 1e-9)))
    return float(np.floor(value * 10**digits) / 10**digits)
