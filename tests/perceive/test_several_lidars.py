"""With a LiDAR in front and one behind, all round is seen, and each forgets only what it sees."""

import math

import numpy as np
import pytest

from cohelm.core.types import Pose, disc
from cohelm.perceive.pipeline import Perception, Seen
from cohelm.robot.port import Scan
from cohelm.scenario.load import robot
from cohelm.sim.kinematic import Kinematic
from cohelm.sim.world import Body, world

REAR = robot("sally-rear")
FRONT_ONLY = robot("sally")
ROOM = np.array([[-6, -3, 4, -3], [4, -3, 4, 3], [4, 3, -6, 3], [-6, 3, -6, -3]], dtype=np.float64)


def from_behind(speed: float) -> Body:
    x, y, _, _, radius, safe = disc(-3.5, 0.0, 0.25, 0.7)
    return Body((x, y, speed, 0.0, radius, safe))


def stood(model, people=(), seconds=3.0, reported=lambda readings: readings):
    """What a robot that stands has seen after so long."""
    plant = Kinematic(model, Pose(0.0, 0.0, 0.0), world((people, ROOM)), seed=3)
    eyes, seen = Perception(model), None
    for k in range(round(seconds / 0.02)):
        plant.wait(0.02 * k)
        seen = eyes.take(plant.now(), reported(plant.read()))
    return seen


def test_a_mover_from_behind_is_seen():
    seen = stood(REAR, [from_behind(0.5)])
    assert len(seen.movers)
    nearest = seen.movers[np.hypot(seen.movers[:, 0] + 2.0, seen.movers[:, 1]).argmin()]
    assert nearest[:2] == pytest.approx([-2.0, 0.0], abs=0.15)
    assert nearest[2:4] == pytest.approx([0.5, 0.0], abs=0.3)
    assert not len(stood(FRONT_ONLY, [from_behind(0.5)]).movers)


def unseen(seen: Seen) -> np.ndarray:
    return seen.obstacles.points[seen.unobserved]


def test_no_ground_is_unseen_where_two_lidars_look_all_round_together():
    assert len(unseen(stood(FRONT_ONLY, seconds=0.3))) > 0
    assert len(unseen(stood(REAR, seconds=0.3))) == 0


def test_before_the_first_rear_scan_the_ground_behind_is_unobserved():
    seen = stood(REAR, seconds=0.3, reported=lambda readings: readings._replace(further=()))
    assert len(unseen(seen)) > 0


def test_what_one_has_seen_the_other_does_not_forget_for_it():
    """A low box is seen by the front LiDAR alone; the rear one looks over it."""
    plant = Kinematic(REAR, Pose(0.0, 0.0, 0.0), world(([], ROOM)), seed=3)
    lidar = REAR.lidars[0].lidar()
    bearings = lidar.first + lidar.step * np.arange(720)
    box = np.abs(bearings - 1.5) < 0.1
    eyes, seen = Perception(REAR), None
    for k in range(40):
        plant.wait(0.02 * k)
        readings = plant.read()
        ranges = np.where(box, 0.7, readings.scan.ranges)
        scan = Scan(readings.scan.stamp, readings.scan.number, ranges, 0.0, "front")
        seen = eyes.take(plant.now(), readings._replace(scan=scan))
    place = (0.3 + 0.7 * math.cos(1.5), 0.7 * math.sin(1.5))
    assert np.hypot(*(seen.obstacles.points - place).T).min() < 0.03


@pytest.mark.parametrize("which", ["odometry", "scans"])
def test_after_stamps_of_tomorrow_a_mover_is_tracked_where_it_is(which):
    """Readings of the future are left out, or nothing that comes later would be new."""

    def reported(readings):
        if not 0.5 < readings.odometry.stamp < 1.0:
            return readings
        if which == "odometry":
            stamp = readings.odometry.stamp + 86_400.0
            return readings._replace(odometry=readings.odometry._replace(stamp=stamp))
        scan, *further = (
            one._replace(stamp=one.stamp + 86_400.0) for one in (readings.scan, *readings.further)
        )
        return readings._replace(scan=scan, further=tuple(further))

    seen = stood(REAR, [from_behind(0.5)], reported=reported)
    nearest = seen.movers[np.hypot(seen.movers[:, 0] + 2.0, seen.movers[:, 1]).argmin()]
    assert nearest[:2] == pytest.approx([-2.0, 0.0], abs=0.15)
    assert nearest[2:4] == pytest.approx([0.5, 0.0], abs=0.3)
