"""What a robot that has only a LiDAR makes of things that move, in the fast simulator."""

import math
from dataclasses import replace

import numpy as np
import pytest

from cohelm.core.types import Pose
from cohelm.law.reference import through
from cohelm.robot.achievable import stopping_distance
from cohelm.robot.clearance import disc_clearance
from cohelm.scenario.load import robot
from cohelm.sim import closed_loop
from cohelm.sim.run import run
from cohelm.sim.setup import Setup, with_pilot
from cohelm.sim.world import Body, world
from cohelm.study.campaign import rooms

SALLY = robot("sally")
ROOM = [[-2, -4, 8, -4], [8, -4, 8, 4], [8, 4, -2, 4], [-2, 4, -2, -4]]


def crossing(*bodies: Body) -> Setup:
    """Six metres straight ahead."""
    return Setup(
        Pose(0.0, 0.0, 0.0), through([[0, 0], [2, 0], [4, 0], [6, 0]], 0.5), SALLY.outline,
        SALLY.bounds(), obstacles=world((list(bodies), np.array(ROOM, dtype=float))), dt=0.02,
        names=tuple(f"body_{i}" for i in range(len(bodies))), duration=40.0,
    )  # fmt: skip


def watched(monkeypatch, setup):
    """A run, and what was known after each scan with its time."""
    known, look = [], closed_loop.look

    def remembered(k, dt, robot, scene, scanners, eyes):
        scanned = any(k == one.next for one in scanners)
        seen = look(k, dt, robot, scene, scanners, eyes)
        if scanned:
            known.append((k * dt, seen.obstacles))
        return seen

    monkeypatch.setattr(closed_loop, "look", remembered)
    return run(setup), known


def test_a_walker_is_followed_with_its_velocity_and_let_pass(monkeypatch):
    walker = Body((3.0, -2.5, 0.0, 0.5, 0.25, 0.6))
    made, known = watched(monkeypatch, with_pilot(crossing(walker), lidars=SALLY.lidars))
    assert made.rows["arrived"][-1]
    assert made.rows["clearance"].min() > 0.05
    at = [(t, told.discs) for t, told in known if 1.5 <= t < 4.5]
    told = [(t, d) for t, discs in at for d in discs if abs(d[0] - 3.0) < 0.5]
    assert len(told) > 0.8 * len(at)
    for t, d in told:
        off = math.hypot(d[0] - 3.0, d[1] + 2.5 - 0.5 * t)
        assert off + 0.25 < d[4] + 0.1
        assert math.hypot(d[2], d[3] - 0.5) < 0.3


@pytest.mark.parametrize(("rear_hz", "age"), [(2.5, 0.4), (50.0, 0.1)])
def test_what_it_stops_within_counts_its_slowest_lidar(monkeypatch, rear_hz, age):
    """As on a real robot: what the rear one shows is as old as that when its next scan is there."""
    told, perception = [], closed_loop.Perception

    def counted(*given, **named):
        told.append(named["stopping"])
        return perception(*given, **named)

    monkeypatch.setattr(closed_loop, "Perception", counted)
    front = SALLY.lidar.model_copy(update={"rate_hz": 10.0})
    rear = front.model_copy(update={"name": "rear", "rate_hz": rear_hz})
    seeing = with_pilot(crossing(), lidars=(front, rear))
    run(replace(seeing, duration=0.1))
    assert told == [pytest.approx(stopping_distance(SALLY.bounds(), age))]


def test_in_a_static_world_no_mover_is_reported(monkeypatch):
    standing = [Body((2.0, 0.1, 0.0, 0.0, 0.2, 0.6)), Body((4.0, -0.8, 0.0, 0.0, 0.3, 0.6))]
    made, known = watched(monkeypatch, with_pilot(crossing(*standing), lidars=SALLY.lidars))
    assert made.rows["arrived"][-1]
    assert made.rows["clearance"].min() > 0.02
    assert not any(len(told.discs) for _, told in known)
    assert len(known) == pytest.approx(made.rows["t"][-1] * SALLY.lidar.rate_hz, abs=2)


@pytest.mark.slow
def test_in_random_rooms_no_followed_person_is_hit(monkeypatch):
    """20 rooms with Sally's own LiDAR, blind to the rear. Walkers mind nobody: they step out from
    behind things, or through them, and come from where it does not see."""
    begun = []
    for number in range(20):
        setup = with_pilot(rooms.case(1, number).setup, lidars=SALLY.lidars)
        made, known = watched(monkeypatch, replace(setup, near=rooms.NEAR))
        monkeypatch.undo()
        assert made.rows["arrived"][-1], number
        begun += [(number, *told) for told in driven_into(made, setup.outline, known)]
    assert len(begun) <= 20
    assert [told for told in begun if told[-1]] == []


def driven_into(made, outline, known):
    """Names and times of contacts that began while the robot moved, and whether the robot had
    followed that walker all through the second before."""
    rows = made.rows
    moves = (rows["applied_v"] != 0.0) | (rows["applied_omega"] != 0.0)
    for i, name in enumerate(made.names):
        d = made.discs[:, i]
        touched = np.zeros(len(rows), dtype=bool)
        far = np.hypot(d[:, 0] - rows["x"], d[:, 1] - rows["y"]) - d[:, 4]
        for k in np.flatnonzero(far < 0.5):
            pose = Pose(rows["x"][k], rows["y"][k], rows["psi"][k])
            touched[k] = disc_clearance(pose, outline, d[k, 0], d[k, 1], d[k, 4]) <= 0.0
        for k in np.flatnonzero(touched & ~np.roll(touched, 1)):
            if moves[k]:
                t = rows["t"][k]
                last = [(at, told.discs) for at, told in known if t - 1.0 <= at <= t]
                yield name, t, all(_is_among(d[round(at / made.dt)], told) for at, told in last)


def _is_among(disc, told):
    return bool((np.hypot(told[:, 0] - disc[0], told[:, 1] - disc[1]) < 0.3).any())
