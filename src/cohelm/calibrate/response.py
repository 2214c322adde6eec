"""Delay, lag, acceleration and braking, from the odometry's response to the commands.

The model: a command arrives after a delay, the drives follow it no faster than they accelerate or
brake, and the wheels follow those with a first-order lag. While a speed is held, the integral part
of the drives' controllers winds up, and they overshoot after a ramp; at rest it is reset. All is
fitted at once, by least squares on the distance between two odometry readings, which is right
whatever a robot reports as its speed, and when.

Straights and turns share the delay, for the commands take the same path. Not the lag: wheels that
push a mass in a straight turn a moment of inertia in a turn.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from cohelm.calibrate.interval import half_widths
from cohelm.calibrate.ride import Ride
from cohelm.core.errors import CohelmError
from cohelm.core.jit import jit
from cohelm.core.types import Floats, Ints
from cohelm.robot.limits import ramps
from cohelm.robot.model import RobotModel

_STEP = 0.002  # of the modelled response [s]
_CYCLE = 0.01
"""Drives take up commands, and make a ramp in steps, in cycles that are not known, but as a rule no
longer than this: the 100 Hz of `ros2_control` [s]. Such a ramp is up to half a cycle before or
after the straight one of the model, in all motions alike: no residual shows it."""
_TAIL = 0.4  # after standing, so long is still looked at [s]
_MOST_DELAY, _MOST_LAG = 0.8, 0.5  # [s]
_LEAST_LAG = 0.001  # less counts as none [s]
_REACHED = 0.97  # of a command's speed
_HELD = 0.99  # of its fastest, a speed is held
_END = 0.25  # before a motion ends its speed is held for so long [s]
_USUAL = (2.0, 4.0)  # where a model has no limit the fit begins here [m/s^2, rad/s^2]


class Measured(NamedTuple):
    """A value and half the width of its 95 % interval."""

    value: float
    off: float


class AxisResponse(NamedTuple):
    """Straights, or turns: in m or rad."""

    lag: Measured
    """Time constant of the wheels [s]."""
    total: Measured
    """Delay and lag together, which are known better than each [s]."""
    rise: Measured
    """Acceleration, as far as it was commanded: the commands' own ramp bounds it."""
    brake: Measured
    gain: Measured
    """Of the odometry's speed to the command's."""
    speed: float
    """Reached and held, by the odometry."""
    commanded: float
    """The fastest that was commanded."""
    noise: float
    """Standard deviation of the way between two readings from the model, at a held speed."""
    times: Floats
    seen: Floats
    """Speed between two readings, (n,)."""
    fitted: Floats
    """The same of the model."""


class Response(NamedTuple):
    """How the robot answers."""

    delay: Measured
    """From a command to the first movement [s]."""
    straight: AxisResponse
    turn: AxisResponse

    @property
    def total(self) -> Measured:
        """Delay and lag of the slower response: what a guard has to predict [s]."""
        return max(self.straight.total, self.turn.total)


class _Data(NamedTuple):
    begin: float
    grid: Floats
    """Times of the model [s]."""
    commanded: Floats
    """Integral of the command up to each command [m, rad], (k,)."""
    at: Floats
    """When each command was sent [s]."""
    rate: Floats
    first: Floats
    last: Floats
    """Stamps of the readings before and after each way [s]."""
    way: Floats
    motion: Ints
    """In which motion of the ride that is."""


def response(model: RobotModel, ride: Ride) -> Response:
    """Fit all motions of a ride. Raises CohelmError where the data are not enough."""
    data = [_data(ride, straight) for straight in (True, False)]
    if any(len(d.way) < 30 for d in data):
        why = f"{ride.ended}; " if ride.ended else ""
        raise CohelmError(
            f"{why}too little was driven to find delay and lag ({len(ride.segments)} motions; the "
            "straights come after 16 turns): nothing is written, drive again"
        )
    limits = model.bounds()
    given = ramps(limits)
    assumed = [a if a < math.inf else b for a, b in zip(given, _USUAL, strict=True)]
    # delay; of each axis lag, acceleration, braking and gain; what the drives add up
    scale = np.array([0.05, *(number for a in assumed for number in (0.05, a, a, 1.0)), 5.0])

    def ways(p: Floats, channel: int) -> Floats:
        lag, rise, brake, gain = p[1 + 4 * channel : 5 + 4 * channel]
        return _ways(data[channel], p[0], lag, rise, brake, gain, p[9], most[channel])

    sigma = [1.0, 1.0]

    def residual(q: Floats) -> Floats:
        p = (q - shift) * scale
        return np.concatenate([(ways(p, c) - data[c].way) / sigma[c] for c in range(2)])

    most = [math.inf, math.inf]
    # a derivative is taken over a share of a number: none may be near 0
    shift = np.array([1.0, *([1.0, 0.0, 0.0, 0.0] * 2), 1.0])
    sigma = [float(np.std(d.way)) or 1.0 for d in data]
    low = np.array([0.0, *([_LEAST_LAG / 0.05, 0.05, 0.05, 0.7] * 2), 0.0]) + shift
    high = np.array([_MOST_DELAY / 0.05, *([_MOST_LAG / 0.05, 8.0, 8.0, 1.4] * 2), 4.0]) + shift
    starts = [
        np.array([d / 0.05, *([0.4, rise, rise, 1.0] * 2), 0.0]) + shift
        for d in np.arange(0.0, 0.5, 0.02) for rise in (0.7, 1.0)
    ]  # fmt: skip
    start = min(starts, key=lambda q: float(np.sum(residual(q) ** 2)))

    def fit(begin: Floats, most: int | None = None) -> Any:
        """From there on, with at most so many looks."""
        bounds, steps = (low, high), np.full(10, 1e-3)
        return least_squares(residual, begin, bounds=bounds, diff_step=steps, max_nfev=most)

    best, p, reached = start, start, [(0.0, 0.0)] * 2
    for _ in range(3):
        best = np.asarray(fit(np.clip(best, low + 1e-6, high - 1e-6)).x, dtype=np.float64)
        p = (best - shift) * scale
        sigma = [max(float(np.sqrt(np.mean((ways(p, c) - data[c].way) ** 2))), 1e-9)
                 for c in range(2)]  # fmt: skip
        for c, straight in enumerate((True, False)):
            held, span = _Held(ride, straight, data[c], float(p[0])), data[c].last - data[c].first
            reached[c], most[c] = held.reached(data[c].way / span), math.inf
            most[c] = held.most(data[c].way / span, ways(p, c) / span)
    jacobian = fit(best, 1).jac
    each = np.diag(scale)
    sums = np.vstack((each, each[0] + each[1], each[0] + each[5]))
    motions = np.concatenate([d.motion for d in data])
    half = half_widths(np.asarray(jacobian, dtype=np.float64), residual(best), motions, sums)
    times = [0, 1, 5, 10, 11]  # the model knows them by its steps
    half[times] = np.sqrt(half[times] ** 2 + (0.5 * _STEP) ** 2 + (0.5 * _CYCLE) ** 2)

    def channel(c: int) -> AxisResponse:
        lag, rise, brake, gain = (Measured(float(p[i]), float(half[i]))
                                  for i in range(1 + 4 * c, 5 + 4 * c))  # fmt: skip
        total = Measured(float(p[0]) + lag.value, float(half[10 + c]))
        if rise.value >= given[c]:  # more was not commanded, and is not known
            rise = Measured(given[c], 0.0)
        span, fitted = data[c].last - data[c].first, ways(p, c)
        held = np.abs(fitted / span) > _HELD * np.max(np.abs(fitted / span))
        noise = float(np.std((data[c].way - fitted)[held]))
        return AxisResponse(
            lag, total, rise, brake, gain, *reached[c], noise, data[c].last, data[c].way / span,
            fitted / span,
        )  # fmt: skip

    return Response(Measured(float(p[0]), float(half[0])), channel(0), channel(1))


def steps(trail: Floats) -> Floats:
    """Way along the heading, and turn, between each two rows of a trail, (n - 1, 2) [m, rad]."""
    turn = (np.diff(trail[:, 3]) + math.pi) % (2.0 * math.pi) - math.pi
    middle = trail[:-1, 3] + 0.5 * turn
    along = np.cos(middle) * np.diff(trail[:, 1]) + np.sin(middle) * np.diff(trail[:, 2])
    return np.column_stack((along, turn))


def _data(ride: Ride, straight: bool) -> _Data:
    commands = np.array(ride.commands)
    at, rate = commands[:, 0], commands[:, 1 if straight else 2]
    trail = ride.trail()
    moved = steps(trail)[:, 0 if straight else 1]
    first, last = trail[:-1, 0], trail[1:, 0]
    motion = np.full(len(moved), -1)
    for number, (start, ended, segment) in enumerate(ride.segments):
        if (segment.twist.v != 0.0) == straight:
            motion[(first > start - 0.1) & (last < ended + _TAIL)] = number
    used = motion >= 0
    commanded = np.concatenate(([0.0], np.cumsum(rate[:-1] * np.diff(at))))
    grid = np.arange(trail[0, 0] - _STEP, trail[-1, 0] + _STEP, _STEP)
    return _Data(float(grid[0]), grid, commanded, at, rate, first[used], last[used], moved[used],
                 motion[used])  # fmt: skip


class _Held:
    """How fast straights, or turns, are at the end of their command, with a delay that is known."""

    def __init__(self, ride: Ride, straight: bool, data: _Data, delay: float) -> None:
        self._ends: list[tuple[float, Any]] = []
        """The commands, and which readings are at their end."""
        for start, ended, segment in ride.segments:
            commanded = abs(segment.twist.v if straight else segment.twist.omega)
            whole = (data.at >= start) & (data.at < ended) & (abs(data.rate) > _HELD * commanded)
            if commanded and whole.any():
                until = data.at[min(np.flatnonzero(whole)[-1] + 1, len(data.at) - 1)] + delay
                self._ends.append((commanded, (data.first > until - _END) & (data.last < until)))
        self._ends = [one for one in self._ends if one[1].sum() >= 3]

    def reached(
        self, speeds: Floats, which: Callable[[list[float]], float] = max
    ) -> tuple[float, float]:
        """The speed of the fastest motions (or slowest), and the command.

        speeds: of each reading interval of the data.
        """
        if not self._ends:
            return 0.0, math.nan
        commanded = which([one for one, _ in self._ends])
        alike = [end for one, end in self._ends if abs(one / commanded - 1.0) < 0.01]
        return float(np.median([np.median(abs(speeds[end])) for end in alike])), commanded

    def most(self, seen: Floats, fitted: Floats) -> float:
        """The fastest command that is followed, where the robot does not do more; else inf.

        fitted: as if it did more. It may do a little less at every speed, as a gyro sees a robot
        with a wide track, and as regulated drives do more at first: its slowest motions decide.
        """
        if not self._ends:
            return math.inf
        fast, slow = (
            self.reached(seen, which)[0] / max(self.reached(fitted, which)[0], 1e-9)
            for which in (max, min)
        )
        return self.reached(seen)[1] * fast / slow if fast < _REACHED * slow else math.inf


def _ways(
    data: _Data, delay: float, lag: float, rise: float, brake: float, gain: float, integral: float,
    most: float,
) -> Floats:  # fmt: skip
    """What the model goes between the readings."""
    edges = np.append(data.grid, data.grid[-1] + _STEP)
    end = np.append(data.commanded, data.commanded[-1] + data.rate[-1])
    total = np.interp(edges, np.append(data.at, data.at[-1] + 1.0), end)
    wanted = np.clip(np.diff(total) / _STEP, -most, most)
    travelled = _answer(wanted, _STEP, lag, rise, brake, integral)
    # the answer is shifted, not the command: a ramp forgets by what part of a step it began late
    times = data.grid + (_STEP + delay)
    return gain * (np.interp(data.last, times, travelled) - np.interp(data.first, times, travelled))


@jit
def _answer(
    wanted: Floats, step: float, lag: float, rise: float, brake: float, integral: float
) -> Floats:
    """Way of the wheels at the end of each step."""
    travelled = np.empty(len(wanted))
    driven, held, speed, way = 0.0, 0.0, 0.0, 0.0
    share = 1.0 - math.exp(-step / max(lag, 1e-6))
    for i in range(len(wanted)):
        change = wanted[i] - driven
        slower = abs(driven) > 1e-6 and change * driven < 0.0  # not by rounding
        most = (brake if slower else rise) * step
        moved = min(max(change, -most), most)
        driven += moved
        if abs(driven) < 1e-6:
            held = 0.0
        elif abs(moved) < 1e-6:
            held += integral * step * (driven - speed)
        before = speed
        speed += share * (driven + held - speed)
        way += 0.5 * (before + speed) * step
        travelled[i] = way
    return travelled
