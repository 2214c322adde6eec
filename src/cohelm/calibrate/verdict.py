"""What a robot's model assumes, beside what was measured: is it safe to rely on?"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

import numpy as np

from cohelm.calibrate.mount import Mount
from cohelm.calibrate.response import Measured, Response
from cohelm.robot.model import RobotModel

Verdict = Literal["safe", "unsafe", "wasteful"]
_WASTE = 0.15  # an assumption that gives away more than this share is wasteful
_DELAY = 0.02  # ... or so much time [s]
_PLACE, _TURN = 0.01, math.radians(0.5)  # a mount is well enough known within this [m, rad]
_WHEEL = 0.01  # and a wheel or track within this share


class Finding(NamedTuple):
    """One key of the robot's file."""

    key: str
    """As in its YAML file, `limits.speed_mps`."""
    assumed: float | None
    measured: Measured
    write: float
    """What to assume from now on: on the safe side of the interval."""
    verdict: Verdict
    why: str
    """In plain words."""


def findings(model: RobotModel, response: Response, mount: Mount) -> list[Finding]:
    """Of a run. Limits are never written larger than what was tried."""
    scale = mount.way
    found = [_delay(model, response)]
    straight, turn = response.straight, response.turn
    real = scale.value
    around = mount.heading.value
    track = model.track_m * scale.value / mount.heading.value
    v = _least(real, straight.rise, straight.brake)
    alpha = _least(around, turn.rise, turn.brake)
    wheel_turn = Measured(0.5 * track * alpha.value, 0.5 * track * alpha.off)
    given = model.limits
    if given.wheel_acceleration_mps2 is not None:
        both = min(v, wheel_turn, key=lambda m: m.value)
        found.append(_limit("limits.wheel_acceleration_mps2", given.wheel_acceleration_mps2, both))
    if given.acceleration_mps2 is not None or given.wheel_acceleration_mps2 is None:
        found.append(_limit("limits.acceleration_mps2", given.acceleration_mps2, v))
    if given.yaw_acceleration_radps2 is not None or given.wheel_acceleration_mps2 is None:
        found.append(_limit("limits.yaw_acceleration_radps2", given.yaw_acceleration_radps2, alpha))
    for key, assumed, channel, factor in (
        ("limits.speed_mps", given.speed_mps, straight, real),
        ("limits.yaw_rate_radps", given.yaw_rate_radps, turn, around),
    ):
        if assumed is not None and channel.asked > 0.98 * assumed:
            found.append(_speed(key, assumed, channel.speed * factor))
    radius = Measured(model.wheel_radius_m * scale.value, model.wheel_radius_m * scale.off)
    found.append(_exact("wheel_radius_m", model.wheel_radius_m, radius,
                        _WHEEL * model.wheel_radius_m, "m"))  # fmt: skip
    off = track * math.hypot(scale.off / scale.value, mount.heading.off / mount.heading.value)
    found.append(_exact("track_m", model.track_m, Measured(track, off), _WHEEL * track, "m"))
    if model.lidar is not None:
        lidar = model.lidar
        degrees = Measured(math.degrees(mount.yaw.value), math.degrees(mount.yaw.off))
        found += [
            _exact("lidar.mount_x_m", lidar.mount_x_m, mount.x, _PLACE, "m"),
            _exact("lidar.mount_y_m", lidar.mount_y_m, mount.y, _PLACE, "m"),
            _exact("lidar.mount_yaw_deg", lidar.mount_yaw_deg, degrees, math.degrees(_TURN), "deg"),
            _noise(lidar.noise_m, mount.noise),
        ]
    return found


def odometry_noise(model: RobotModel, response: Response, mount: Mount) -> dict[str, float]:
    """The odometry's errors, as the robot's file has them: only simulated robots use these."""
    channel = response.straight
    way = max(channel.speed / model.odometry.rate_hz, 1e-6)  # between two readings
    turn = response.turn.noise * model.odometry.rate_hz
    return {
        "odometry.distance_error": abs(mount.way.value - 1.0),
        "odometry.slip": channel.noise * math.sqrt(2.0 / way),
        "odometry.gyro_noise_degps": math.degrees(turn),
    }


def with_load(found: list[Finding], earlier: Mapping[str, Any]) -> list[Finding]:
    """The worse of two runs for what a load changes; the rest is of the run without it.

    earlier: `as_dict` of that run, by key.
    """
    made: list[Finding] = []
    for one in found:
        before = earlier.get(one.key)
        if before is None:
            made.append(one)
            continue
        was = Finding(
            one.key, before["assumed"], Measured(before["measured"], before["off"]),
            before["write"], before["verdict"], before["why"],
        )  # fmt: skip
        if one.key == "delay_s":
            made.append(max(one, was, key=lambda f: f.write))
        elif one.key.startswith("limits."):
            made.append(min(one, was, key=lambda f: f.write))
        else:
            made.append(was)
    return made


def as_dict(found: list[Finding]) -> dict[str, Any]:
    """By key, for JSON."""
    return {
        one.key: {
            "assumed": one.assumed, "measured": one.measured.value, "off": one.measured.off,
            "write": one.write, "verdict": one.verdict, "why": one.why,
        }
        for one in found
    }  # fmt: skip


def _delay(model: RobotModel, response: Response) -> Finding:
    total = response.total
    assumed = model.delay_s
    if total.value - total.off > assumed + 0.005:
        verdict, why = (
            "unsafe",
            f"it obeys {1e3 * (total.value - assumed):.0f} ms later: it stops "
            "farther on than is foretold",
        )
    elif assumed > total.value + _DELAY:
        verdict, why = "wasteful", "it obeys earlier: it keeps away farther than it has to"
    else:
        verdict, why = "safe", "it obeys as foretold"
    return Finding("delay_s", assumed, total, round(total.value, 3), verdict, why)


def _least(scale: float, *values: Measured) -> Measured:
    least = min(values, key=lambda m: m.value)
    return Measured(scale * least.value, scale * least.off)


def _limit(key: str, assumed: float | None, seen: Measured) -> Finding:
    write = _down(seen.value - seen.off)
    if assumed is None:
        return Finding(key, None, seen, write, "unsafe", "no end of braking is assumed")
    if seen.value + seen.off < 0.97 * assumed:
        return Finding(
            key, assumed, seen, write, "unsafe", "it can not stop where the guard counts on it"
        )
    if seen.value > (1.0 + _WASTE) * assumed:
        return Finding(key, assumed, seen, assumed, "wasteful", "it can do more")
    # within the fit's own error: what is assumed stays
    return Finding(
        key, assumed, seen, min(assumed, seen.value + seen.off), "safe", "it does what is assumed"
    )


def _speed(key: str, assumed: float, seen: float) -> Finding:
    measured = Measured(seen, 0.01 * seen)
    if seen < 0.97 * assumed:
        return Finding(key, assumed, measured, _down(seen), "unsafe", "it is not reached")
    if seen > 1.03 * assumed:
        return Finding(key, assumed, measured, assumed, "unsafe", "it is faster than it is told: "
                       "correct wheel_radius_m or track_m in its base")  # fmt: skip
    return Finding(key, assumed, measured, assumed, "safe", "it is reached, and held")


def _exact(key: str, assumed: float, seen: Measured, room: float, unit: str) -> Finding:
    off = seen.value - assumed
    if abs(off) > room + seen.off:
        return Finding(
            key, assumed, seen, round(seen.value, 4), "unsafe", f"it is {off:+.3g} {unit} off"
        )
    return Finding(key, assumed, seen, assumed, "safe", "it is as assumed")


def _noise(assumed: float, seen: float) -> Finding:
    measured = Measured(seen, 0.1 * seen)
    if seen > 1.2 * assumed + 1e-3:
        return Finding("lidar.noise_m", assumed, measured, round(seen, 4), "unsafe",
                       "the ranges scatter more: less is kept free than is needed")  # fmt: skip
    if seen < 0.5 * assumed:
        return Finding("lidar.noise_m", assumed, measured, assumed, "wasteful", "they scatter less")
    return Finding("lidar.noise_m", assumed, measured, assumed, "safe", "they scatter no more")


def _down(value: float) -> float:
    """Three digits, never more than the value."""
    digits = 2 - math.floor(math.log10(max(value, 1e-9)))
    return float(np.floor(value * 10**digits) / 10**digits)
