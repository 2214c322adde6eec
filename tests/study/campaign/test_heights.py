"""The suite heights: its worlds keep their word, and a robot that watches the floor ahead is not
pushed over an edge that it never saw."""

import math
from dataclasses import replace

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose, Twist
from cohelm.law.reference import through
from cohelm.robot.gate.gate import Passed
from cohelm.sim.heights import Heights, drop, edges, fallen
from cohelm.sim.world import world
from cohelm.study.campaign import heights, suites
from cohelm.study.campaign.heights_run import towards
from cohelm.study.campaign.loop_run import Watched
from cohelm.study.campaign.scoring import run_episode


def beside_a_dock(bearing: float, hand: str = "back"):
    """An attacker's episode on a wide floor that ends 1.35 m from the robot, to whose right or
    left, or wherever the bearing says [rad]."""
    case = next(c for k in range(40) if (c := heights.case(5, k)).goal is None and k % 3 < 2)
    far = 1.35 + 2.0
    x, y = far * math.cos(bearing), far * math.sin(bearing)
    rows = np.array([drop(x, y, bearing, 4.0, 30.0, 1.0)])
    assert case.uneven is not None
    setup = replace(
        case.setup, start=Pose(0.0, 0.0, 0.0), reference=through([[0.0, 0.0], [1.0, 0.0]], 1.0),
        obstacles=world(([], np.array([[-9.0, 9.0, 9.0, 9.0]]))),
        barred=np.array([[-9.0, 9, 9, 9]]), duration=15.0,
    )  # fmt: skip
    uneven = replace(
        case.uneven, heights=Heights(drops=rows), operator=hand, edges=edges(rows),
        loads=case.uneven.loads[:1],
    )  # fmt: skip
    return replace(case, setup=setup, uneven=uneven)


def looking_round(case):
    """The same with a LiDAR that looks all round."""
    assert case.setup.twin is not None
    twin = case.setup.twin
    lidar = twin.robot.lidar
    assert lidar is not None
    wide = lidar.model_copy(update={"field_of_view_deg": 360.0, "mount_x_m": 0.0})
    model = twin.robot.model_copy(update={"lidar": wide})
    return replace(case, setup=replace(case.setup, twin=replace(twin, robot=model)))


@pytest.mark.slow
@pytest.mark.parametrize("bearing", [100.0, -110.0, 125.0, 179.0])
def test_no_command_backs_it_over_an_edge_that_only_the_lidar_looked_past(bearing):
    """The LiDAR looks there and sees nothing that stands; the camera never did. Before floor was
    asked for, three of these fell."""
    case = looking_round(beside_a_dock(math.radians(bearing)))
    row = run_episode(case, "guard")
    assert (row.falls, row.contacts_moving) == (0, 0)
    assert row.path_length_m > 0.4


@pytest.mark.slow
def test_a_robot_driven_over_an_edge_without_a_filter_counts_as_fallen(monkeypatch):
    """The judge works: whoever is let through everything falls."""

    def through(gated, proposal):
        gated._monitors = ()
        gated._robot.send(Twist(-0.3, 0.0))
        return Passed(gated.gate.applied, "")

    monkeypatch.setattr(Watched, "propose", through)
    row = run_episode(beside_a_dock(math.pi), "guard")
    assert row.falls == 1
    assert row.duration_s < 8.0


@pytest.mark.parametrize("number", range(12))
def test_a_world_matches_its_description(number):
    case = heights.case(3, number)
    given, setup = case.uneven, case.setup
    assert given is not None
    assert setup.twin is not None
    model = setup.twin.robot
    start = np.array(setup.start[:2])
    high = model.height_m
    assert heights.clearances(given.heights, start[:1], start[1:], high)[0] >= heights.CLEAR
    assert fallen(given.heights, np.array([setup.start]), given.wheels) == -1
    stated = model.limits.wheel_acceleration_mps2
    assert stated is not None
    for load in given.loads:
        assert stated <= load.brakes <= 2.0 * stated
        assert model.delay_s / 3.0 <= load.delay <= model.delay_s
    assert len(given.loads) == 1 + number % 2
    assert np.array_equal(setup.outline, model.outline)
    body = given.heights.boxes[given.heights.boxes[:, 6] < high]
    assert len(setup.obstacles.walls) == 4 + 4 * len(body)
    assert (case.goal is not None) == case.kind.startswith(("controller", "shared"))


def test_worlds_depend_on_seed_and_number_only():
    a, b, c = heights.case(1, 7), heights.case(1, 7), heights.case(2, 7)
    assert a.setup.obstacles.walls.tolist() == b.setup.obstacles.walls.tolist()
    assert a.setup.obstacles.walls.tolist() != c.setup.obstacles.walls.tolist()


def test_a_hand_pushes_at_the_nearest_edge_ahead_or_tail_first():
    wall = np.array([[2.0, -1.0, 2.0, 1.0]])
    at = Pose(0.0, 0.0, 0.0)
    assert towards(at, wall, False) == pytest.approx((1.0, 0.0))
    assert towards(at, wall, True)[0] == 0.0  # it turns first
    away = Pose(0.0, 0.0, math.pi - 0.1)
    ahead, left = towards(away, wall, True)
    assert ahead == pytest.approx(-math.cos(0.1))
    assert left == pytest.approx(math.sin(0.1))
    assert towards(at, np.empty((0, 4)), True) == (0.0, 0.0)


def test_the_suite_is_driven_on_the_twin_and_on_no_other_plant():
    assert suites.suite("heights", 1, None).plant == "twin"
    assert suites.suite("heights", 1, None).laws == ("guard",)
    for plant in ("kinematic", "twin-rear"):
        with pytest.raises(CohelmError, match=f"not driven with --plant {plant}: choose twin$"):
            suites.suite("heights", 1, None, plant)


@pytest.mark.slow
def test_worlds_are_driven_without_a_fall_or_contact():
    rows = [run_episode(heights.case(11, k), "guard") for k in range(10)]
    assert [(row.fault, row.falls, row.contacts_moving) for row in rows] == [("", 0, 0)] * 10
    assert any(row.arrived for row in rows)


@pytest.mark.slow
@pytest.mark.parametrize("number", [2, 11, 20, 27, 30])
def test_a_robot_turns_to_unobserved_floor_and_continues(number):
    """Each stood before such floor, or beside an edge, until its time was over. Here they have half
    as long again: in 11 the operator leads it about for so long that it needs 62 s."""
    case = heights.case(8310, number)
    setup = replace(case.setup, duration=1.5 * case.setup.duration)
    row = run_episode(replace(case, setup=setup), "guard")
    assert (row.fault, row.falls, row.contacts_moving) == ("", 0, 0)
    assert row.arrived
