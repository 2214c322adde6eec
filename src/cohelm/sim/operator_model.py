"""The simulated operator: a replayed stick, or a model that dodges obstacles and lets go."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cohelm.core.facing import facing
from cohelm.core.jit import jit, jit_inline
from cohelm.core.types import RADIUS, Floats, Pose, Stick, StickRecording, X, Y


class OperatorModel(NamedTuple):
    """An operator who watches the way ahead through a camera and dodges what is in it.

    The model, step by step:
    - *see*: a disc is seen while its surface is less than `look_ahead` ahead of the robot's
      centre, its centre not more than `behind` it, and its surface less than twice
      `half_width` from the line of the robot's heading;
    - *notice*: a disc that is seen is in the way while its centre is in front and its surface
      less than `half_width` from that line;
    - *react*: `reaction` after something came in the way, if anything is still seen, the operator
      takes the stick and picks a side, away from the nearest disc (right when it is dead
      ahead), and keeps it;
    - *dodge*: fore-aft the stick goes to `surge`; left-right it points, by `steer` per radian
      and up to `yaw`, at the place that is `berth` beside the nearest disc that is seen, and
      to 0 if none is;
    - *let go*: once nothing has been seen for `linger`, and the stick has been held for `hold`,
      the stick is released;
    - the stick moves no faster than `hand_rate`, and trembles with `tremor` while it is held.
    """

    active: bool = False
    look_ahead: float = 1.0
    """[m]"""
    half_width: float = 0.3
    """[m]"""
    behind: float = 0.0
    """How far past the robot's centre a disc must be to be forgotten [m]."""
    surge: float = 0.57
    """Fore-aft deflection while dodging, in [-1, 1]."""
    yaw: float = 0.66
    """Largest left-right deflection while dodging, in [0, 1]."""
    steer: float = 3.0
    """Left-right deflection per radian of bearing [1/rad]."""
    berth: float = 0.44
    """From a disc's centre to the place beside it that the operator steers for [m]."""
    reaction: float = 1.3
    """[s]"""
    linger: float = 0.0
    """[s]"""
    hold: float = 3.8
    """Shortest time the stick is held [s]."""
    hand_rate: float = 5.0
    """Deflections per second."""
    tremor: float = 0.0
    """Standard deviation of the trembling, in deflection."""


class OperatorState(NamedTuple):
    """The simulated operator between two steps."""

    noticed_at: float
    """When something came in the way, and once the stick is held, when it was taken [s]."""
    seen_at: float
    """When something was last seen [s]."""
    side: float
    """+1 dodging to the left, -1 to the right, 0 stick released."""
    x: float
    psi: float
    """The stick, without its trembling."""


_NEAR = 0.3
"""A place beside a disc counts as at least this far ahead [m]: no steering sideways."""

IDLE = OperatorState(math.inf, -math.inf, 0.0, 0.0, 0.0)


def replay(times: ArrayLike = (), x: ArrayLike = (), psi: ArrayLike = ()) -> StickRecording:
    """A stick from its columns; without any, centred."""
    return StickRecording(*(np.array(column, dtype=np.float64) for column in (times, x, psi)))


@jit_inline
def replayed(stick: StickRecording, t: float) -> Stick:
    """The newest deflection at time t; before the first and after the last event, centred."""
    low, high = 0, len(stick.times)
    if low == high or t < stick.times[low] or t > stick.times[high - 1]:
        return Stick(0.0, 0.0)
    while high - low > 1:
        middle = (low + high) // 2
        if stick.times[middle] <= t:
            low = middle
        else:
            high = middle
    return Stick(float(stick.x[low]), float(stick.psi[low]))


@jit_inline
def uniform(seed: int, k: int) -> float:
    """A uniform number in (0, 1) that depends only on seed and k (SplitMix64)."""
    z = np.uint64(seed) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(k)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return (np.float64(z >> np.uint64(11)) + 0.5) / 9007199254740992.0


@jit_inline
def normal(seed: int, k: int) -> float:
    """A standard normal number that depends only on seed and k, in any thread."""
    radius = math.sqrt(-2.0 * math.log(uniform(seed, 2 * k)))
    return radius * math.cos(2.0 * math.pi * uniform(seed, 2 * k + 1))


@jit
def operate(
    person: OperatorState, operator: OperatorModel, recorded: StickRecording, pose: Pose,
    discs: Floats, noticed: NDArray[np.bool_], k: int, dt: float, seed: int,
) -> tuple[OperatorState, Stick]:  # fmt: skip
    """One step of the simulated operator, or without one of the recorded stick: the new state, and
    the stick."""
    t = k * dt
    if not operator.active:
        return person, replayed(recorded, t)
    c, s = facing(pose.psi)
    nearest, lateral, before = math.inf, 0.0, 0.0
    blocking = False
    for i in range(discs.shape[0]):
        if not noticed[i]:
            continue
        dx, dy = discs[i, X] - pose.x, discs[i, Y] - pose.y
        ahead, left = c * dx + s * dy, -s * dx + c * dy
        clearance = ahead - discs[i, RADIUS]
        off = abs(left) - discs[i, RADIUS]
        if (
            clearance > operator.look_ahead
            or ahead < -operator.behind
            or off > 2.0 * operator.half_width
        ):
            continue
        if ahead > 0.0 and off < operator.half_width:
            blocking = True
        if clearance < nearest:
            nearest, lateral, before = clearance, left, ahead
    seen = nearest < math.inf
    seen_at = t if seen else person.seen_at
    noticed_at, side = person.noticed_at, person.side
    if side != 0.0:
        if t - seen_at >= operator.linger and t - noticed_at >= operator.hold:
            noticed_at, side = math.inf, 0.0
    elif not seen:
        noticed_at = math.inf
    else:
        if blocking:
            noticed_at = min(noticed_at, t)
        if t - noticed_at >= operator.reaction:
            noticed_at, side = t, (1.0 if lateral < -0.02 else -1.0)
    to_x, to_psi = 0.0, 0.0
    if side != 0.0:
        to_x = operator.surge
        if seen:
            bearing = math.atan2(lateral + side * operator.berth, max(before, _NEAR))
            to_psi = min(max(operator.steer * bearing, -operator.yaw), operator.yaw)
    reach = operator.hand_rate * dt
    x = person.x + min(max(to_x - person.x, -reach), reach)
    psi = person.psi + min(max(to_psi - person.psi, -reach), reach)
    stick = Stick(x, psi)
    if side != 0.0 and operator.tremor > 0.0:
        stick = Stick(
            min(max(x + operator.tremor * normal(seed, 2 * k), -1.0), 1.0),
            min(max(psi + operator.tremor * normal(seed, 2 * k + 1), -1.0), 1.0),
        )
    return OperatorState(noticed_at, seen_at, side, x, psi), stick
