"""Obstacles: as a caller in Python gives them, and as compiled code takes them."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cohelm.core.arrays import floats
from cohelm.core.errors import CohelmError
from cohelm.core.types import RADIUS, VX, VY, Floats, Pose, X, Y

_CENTRE = Pose(0.0, 0.0, 0.0)
_MOST_ACCELERATION = 1.0
"""Default max_acceleration of a disc with a velocity: a walking person [m/s^2]."""


class Surroundings(NamedTuple):
    """All obstacles, in the frame of the robot's pose.

    discs: (n, 6), columns as in `core.types`, each moving with its velocity. max_acceleration:
    (n,), assumed largest acceleration of each disc [m/s^2]; 0 for one that keeps its velocity, so
    a standing one with 0 never moves. velocity_error: (n,), error bound of its velocity [m/s]:
    t later the disc is within velocity_error t + max_acceleration t^2 / 2 of its course.
    segments: (m, 4), walls x1, y1, x2, y2 [m]. points: (p, 2), such as LiDAR returns [m].

    A point that is not finite is a beam without a return; a disc or segment that is not finite is
    an error, and the guard brakes. Obstacles are numbered: discs, then segments, then points.
    """

    discs: Floats
    max_acceleration: Floats
    velocity_error: Floats
    segments: Floats
    points: Floats

    def placed(self, body: Pose) -> Surroundings:
        """The same, given in the body frame, in the frame in which the body is at this pose."""
        c, s = math.cos(body.psi), math.sin(body.psi)  # `core.frames` needs the compiler
        turn, at = np.array([[c, s], [-s, c]]), np.array(body[:2])
        return self._replace(
            discs=placed_discs(self.discs, body), points=self.points @ turn + at,
            segments=(self.segments.reshape(-1, 2) @ turn + at).reshape(-1, 4),
        )  # fmt: skip


def placed_discs(discs: Floats, body: Pose) -> Floats:
    """Discs (n, 6), given in the body frame, in the frame in which the body is at this pose."""
    if not len(discs):
        return discs
    c, s = math.cos(body.psi), math.sin(body.psi)
    turn, made = np.array([[c, s], [-s, c]]), discs.copy()
    made[:, X : Y + 1] = discs[:, X : Y + 1] @ turn + np.array(body[:2])
    made[:, VX : VY + 1] = discs[:, VX : VY + 1] @ turn
    return made


class Obstacles:
    """Everything the robot could hit, in one frame, as of now.

    Any frame that rests will do (map, odom), as long as the pose that goes with the obstacles is in
    it; the body frame of now too, with `Pose(0, 0, 0)`.

        >>> import cohelm
        >>> seen = cohelm.Obstacles(points=[[1.0, 0.2]], discs=[[2.0, 0.0, 0.3, -1.0, 0.0]])
        >>> len(seen)
        2

    points: (p, 2) x, y [m], such as LiDAR returns; one that is not finite is a beam that hit
    nothing. discs: (n, 3) x, y, radius [m], which rest, or (n, 5) x, y, radius, v_x, v_y [m, m/s],
    which move. segments: (m, 4), walls x1, y1, x2, y2 [m]. max_acceleration: what the discs are
    taken to be capable of [m/s^2], one number or one per disc; by default 0 for those that rest,
    1 for those whose velocity is given. velocity_error: by how much a velocity may be off [m/s],
    one number or one per disc; by default 0. A disc or segment that is not finite makes the filter
    brake. Points and segments are taken to rest: give discs for what moves.

    As attributes they are arrays, discs (n, 6): x, y, v_x, v_y, radius, 0.

    Arrays of float64 are kept, not copied; do not change them while they are in use. Raises
    CohelmError where a shape or type does not fit.
    """

    __slots__ = ("discs", "max_acceleration", "points", "segments", "velocity_error")

    discs: Floats
    """(n, 6), columns as in `core.types`."""
    max_acceleration: Floats
    """(n,) [m/s^2]."""
    velocity_error: Floats
    """(n,) [m/s]."""
    segments: Floats
    points: Floats

    def __init__(
        self, points: ArrayLike | None = None, discs: ArrayLike | None = None,
        segments: ArrayLike | None = None, *, max_acceleration: ArrayLike | None = None,
        velocity_error: ArrayLike | None = None,
    ) -> None:  # fmt: skip
        self.points = _NO_POINTS if points is None else rows("points", points, 2)
        self.segments = _NO_SEGMENTS if segments is None else rows("segments", segments, 4)
        if discs is None and max_acceleration is None and velocity_error is None:
            self.discs, self.max_acceleration, self.velocity_error = _NO_DISCS, _NOTHING, _NOTHING
            return
        self.discs, moves = _discs(discs)
        usual = _MOST_ACCELERATION if moves else 0.0
        n = len(self.discs)
        self.max_acceleration = per_disc("max_acceleration", max_acceleration, n, usual, 0.0)
        self.velocity_error = per_disc("velocity_error", velocity_error, n, 0.0, 0.0)

    @classmethod
    def from_ranges(
        cls, ranges: ArrayLike, angle_min: float, angle_increment: float, *,
        mount: Pose = _CENTRE, range_min: float = 0.0,
    ) -> Obstacles:  # fmt: skip
        """The points of one LiDAR scan, in the body frame.

        ranges: (n,) [m], as REP-117 has them: inf for no return; what is nearer than range_min [m],
        -inf and 0 too, is put there; NaN is left out. A driver that reports 0 for no return
        needs inf there. angle_min: bearing of the first beam, angle_increment: to the next one,
        counter-clockwise [rad]; negative where it turns clockwise. mount: of the sensor in the
        body. Raises CohelmError where angles, mount or most of the ranges are no scan's, as they
        are in degrees or millimetres, and where there are none at all or all are NaN: no scan is
        not free space.
        """
        far = _array("ranges", ranges)
        if far.ndim != 1:
            raise CohelmError(f"ranges need one number per beam, got shape {far.shape}")
        if not far.size:
            raise CohelmError(
                "there are no ranges, as no scan has come: give the last one, or stop the robot"
            )
        if np.isnan(far).all():
            raise CohelmError(
                "all ranges are NaN, so nothing was measured: look at the LiDAR, or stop the robot"
            )
        try:
            first, step, range_min = float(angle_min), float(angle_increment), float(range_min)
        except (TypeError, ValueError) as error:
            raise CohelmError(
                f"angle_min, angle_increment and range_min are numbers, got {angle_min!r}, "
                f"{angle_increment!r} and {range_min!r}"
            ) from error
        turn = abs(step) * (len(far) - 1)
        round_once = turn <= _TURN and (turn > 0.0 or len(far) == 1)
        if not (abs(first) <= _TURNS and round_once):
            raise CohelmError(
                f"a scan begins within two turns and goes round once, got angle_min={first:g} "
                f"and {len(far)} beams {step:g} apart: give radians"
            )
        if not 0.0 <= range_min <= _BLIND:  # nor for NaN
            raise CohelmError(
                f"range_min is in metres, from 0 to {_BLIND:g}, got {range_min:g}: what is nearer "
                "is put there"
            )
        x, y, yaw = _mounted(mount)
        bearings = yaw + first + step * np.arange(len(far))
        real = np.where(far < range_min, range_min, far)
        hit = np.isfinite(real)
        check_in_metres(real[hit])
        points = np.column_stack((np.cos(bearings[hit]), np.sin(bearings[hit])))
        return cls(points=points * real[hit, None] + (x, y))

    def placed(self, body: Pose) -> Obstacles:
        """The same, given in the body frame, in the frame in which the body is at this pose.

        Raises CohelmError for what is no pose, or is not finite: nobody knows where they are then.
        """
        try:
            x, y, psi = map(float, body)
        except (TypeError, ValueError) as error:
            raise CohelmError(f"placed takes a cohelm.Pose(x, y, psi), got {body!r}") from error
        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(psi)):
            raise CohelmError(
                f"obstacles can not be placed at ({x:g}, {y:g}, {psi:g}), which is no place: "
                "stop the robot until its pose is known"
            )
        made, given = Obstacles.__new__(Obstacles), Surroundings(
            self.discs, self.max_acceleration, self.velocity_error, self.segments, self.points
        )  # fmt: skip
        (
            made.discs, made.max_acceleration, made.velocity_error, made.segments, made.points
        ) = given.placed(Pose(x, y, psi))  # fmt: skip
        return made

    def __len__(self) -> int:
        return len(self.discs) + len(self.segments) + len(self.points)

    def __repr__(self) -> str:
        return (
            f"Obstacles({len(self.points)} points, {len(self.discs)} discs, "
            f"{len(self.segments)} segments)"
        )


def check_in_metres(ranges: Floats, range_max: float = 0.0) -> None:
    """CohelmError where most of these finite ranges are a LiDAR's in millimetres, or in
    centimetres. range_max: what it measures at most, if that is known, else 0 [m]."""
    longest = min(_LONGEST, max(_LONGEST_IN_A_ROOM, 10.0 * range_max))
    if 2 * np.count_nonzero(ranges > longest) > len(ranges):
        median = float(np.median(ranges))
        either = "centimetres by 100, " if median < _MILLIMETRES else ""
        raise CohelmError(
            f"ranges are in metres, got {median:g} in the median: divide {either}"
            "millimetres by 1000"
        )


_TURN = 2.0 * math.pi * 1.01
"""A full turn, with the rounding of drivers that report the increment in float32 [rad]."""
_TURNS = 4.0 * math.pi
_LONGEST = 500.0
"""No LiDAR of a ground robot measures farther; 0.5 m in millimetres [m]."""
_LONGEST_IN_A_ROOM = 100.0  # 1 m in centimetres [m]
_MILLIMETRES = 1000.0  # what is less may be centimetres [m]
_BLIND = 10.0  # no LiDAR is blind for farther [m]
_FARTHEST = 100.0
"""As of an outline's corners [m]."""
_NO_POINTS, _NO_SEGMENTS, _NO_DISCS = np.empty((0, 2)), np.empty((0, 4)), np.empty((0, 6))
_NOTHING = np.empty(0)
_DISC_ROWS = "discs need rows x, y, radius, or x, y, radius, v_x, v_y in metres and m/s"


def _mounted(mount: Pose) -> Pose:
    """The mount of a sensor. Raises CohelmError where it is none."""
    try:
        x, y, psi = map(float, mount)
    except (TypeError, ValueError) as error:
        raise CohelmError(f"mount must be a cohelm.Pose(x, y, psi), got {mount!r}") from error
    if not (abs(x) <= _FARTHEST and abs(y) <= _FARTHEST and abs(psi) <= _TURNS):  # nor for NaN
        raise CohelmError(f"mount is in metres and radians, got ({x:g}, {y:g}, {psi:g})")
    return Pose(x, y, psi)


def _array(name: str, given: ArrayLike | None) -> Floats:
    """None is empty, which NumPy makes a NaN."""
    return _NOTHING if given is None else floats(name, given)


def rows(name: str, given: ArrayLike | None, width: int) -> Floats:
    """(n, width); None is none of them. CohelmError for another shape: compiled code would read
    past the end."""
    made = _array(name, given)
    if made.ndim == 2 and made.shape[1] == width:
        return made
    if made.size == 0:
        return np.empty((0, width))
    raise CohelmError(f"{name} need {width} columns and a row for each, got shape {made.shape}")


def _discs(given: ArrayLike | None) -> tuple[Floats, bool]:
    """(n, 6), columns as in `core.types`, and whether velocities are given."""
    table: Any = np.empty((0, 3)) if given is None else _array("discs", given)
    if table.size == 0:
        table = table.reshape(0, 3)
    if table.ndim != 2 or table.shape[1] not in (3, 5):
        raise CohelmError(f"{_DISC_ROWS}, got shape {table.shape}")
    if (table[:, 2] < 0.0).any():
        raise CohelmError(f"a disc's radius must not be negative, got {table[:, 2].min():g} m")
    moves = table.shape[1] == 5
    made = np.zeros((len(table), 6))
    made[:, [X, Y, RADIUS]] = table[:, :3]
    if moves:
        made[:, [VX, VY]] = table[:, 3:]
    return made, moves


def per_disc(
    name: str, given: ArrayLike | None, n: int, usual: float, least: float = -math.inf
) -> Floats:
    """(n,), a number for each disc, given as such or one for all, none of them below `least`."""
    if given is None:
        return np.full(n, usual)
    made = _array(name, given)
    made = np.full(n, made.item()) if made.size == 1 else made
    if made.shape != (n,) or (made < least).any():
        number = f"a number >= {least:g}" if least > -math.inf else "a number"
        raise CohelmError(f"{name} needs {number} for each of {n} discs, got {made}")
    return made
