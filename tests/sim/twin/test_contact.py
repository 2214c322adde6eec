"""What the twin hits holds it back, and geometry and physics agree on when."""

import math

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose, Twist
from cohelm.robot.model import RobotModel
from cohelm.sim.grid import grid
from cohelm.sim.twin.engine import mujoco
from cohelm.sim.twin.movers import Pursuers
from cohelm.sim.twin.robot import Twin
from tests.sim.twin.drives import brake, disc, drive, sally, scene

AGREE = 0.003  # geometry and physics may differ by so much on where a contact begins [m]


def test_a_wall_holds_the_robot_back():
    robot = Twin(sally(), obstacles=scene(walls=[[1.0, -3.0, 1.0, 3.0]]))
    truth = drive(robot, Twist(0.5, 0.0), 3.0)[-1]
    assert truth.touching
    assert truth.clearance == pytest.approx(0.0, abs=AGREE)
    assert truth.least_moving <= 0.0
    assert truth.touched >= 1
    assert truth.force > 50.0
    assert abs(truth.twist.v) < 0.02


def test_a_robot_that_stops_in_front_of_a_wall_touches_nothing():
    robot = Twin(sally(), obstacles=scene(walls=[[1.0, -3.0, 1.0, 3.0]]))
    drive(robot, Twist(0.5, 0.0), 0.7)
    truth = brake(robot)
    assert truth.clearance > 0.05
    assert truth.least == pytest.approx(truth.clearance, abs=1e-3)
    assert (truth.touched, truth.force) == (0, 0.0)


def outlines() -> list[RobotModel]:
    wedge = [[0.5, 0.0], [0.2, 0.3], [-0.3, 0.2], [-0.3, -0.2], [0.2, -0.3]]
    return [sally(), sally(footprint_m=wedge, name="wedge")]


@pytest.mark.parametrize("model", outlines(), ids=lambda m: m.name)
def test_physics_and_geometry_agree_on_what_touches(model):
    rng = np.random.default_rng(7)
    bodies = [disc(*rng.uniform(-2, 2, 2), rng.uniform(0.05, 0.4)) for _ in range(4)]
    bodies.append(disc(1.5, -1.5, 0.2, 0.3, 0.0))
    solid = np.zeros((8, 8), dtype=bool)
    solid[2:5, 3:6] = True
    robot = Twin(
        model, Pose(9.0, 9.0, 0.0),
        scene(*bodies, walls=[[-2.0, 1.0, 0.5, 2.0], [0.0, -2.5, 0.1, -1.5]]),
        grid=grid(solid, 0.1, Pose(0.5, 0.2, 0.3)),
    )  # fmt: skip
    body = mujoco.mj_name2id(robot.mujoco, mujoco.mjtObj.mjOBJ_GEOM, "body")
    touched = 0
    for _ in range(400):
        x, y, psi = rng.uniform([-2.5, -2.5, -3.1], [2.5, 2.5, 3.1])
        was = robot.truth().pose
        robot.push(x - was.x, y - was.y, psi - was.psi)
        clearance = robot.truth().clearance
        mujoco.mj_forward(robot.mujoco, robot.data)
        found = any(body in (c.geom1, c.geom2) for c in robot.data.contact)
        if abs(clearance) > AGREE:
            assert found == (clearance < 0.0), (x, y, psi, clearance)
        touched += found
    assert 50 < touched < 350


def test_a_walker_into_a_standing_robot_finds_a_path_round_it():
    robot = Twin(sally(), obstacles=scene(disc(2.0, 0.0, 0.25, -0.8, 0.0)))
    seen = []
    for _ in range(1200):
        truth = brake(robot, 0.02)
        seen.append((truth.clearance, *robot.discs()[0, :4]))
    clearances, _, _, vx, vy = np.array(seen).T
    assert truth.touched >= 1
    assert truth.least == pytest.approx(clearances.min(), abs=2e-3)
    assert -0.01 < truth.least <= 0.0
    assert truth.least_moving > 0.0
    assert math.hypot(truth.pose.x, truth.pose.y) < 0.03  # a nudge, not a shove
    assert np.hypot(vx, vy).max() <= 1.25 * 0.8 + 1e-9
    changes = np.hypot(np.diff(vx), np.diff(vy))
    assert np.sort(changes)[-3] <= 0.3 * 0.8  # one bump, perhaps two, and otherwise as people walk
    x, y = robot.discs()[0, :2]
    assert (x, y) == pytest.approx((2.0 - 0.8 * robot.now(), 0.0), abs=0.05)  # back on its way


FAR = Pose(20.0, 20.0, 0.0)


def test_a_walker_towards_a_wall_stays_on_its_side():
    robot = Twin(sally(), FAR, scene(disc(2.0, 0.0, 0.25, -0.8, 0.0), walls=[[0, -9, 0, 9]]))
    for _ in range(300):
        brake(robot, 0.02)
        assert robot.discs()[0, 0] >= 0.25 - 1e-9


def test_a_walker_towards_an_obstacle_goes_round_it():
    robot = Twin(sally(), FAR, scene(disc(2.0, 0.02, 0.25, -0.8, 0.0), disc(0.0, 0.0, 0.3)))
    clearances = []
    for _ in range(1200):
        brake(robot, 0.02)
        walker, thing = robot.discs()
        clearances.append(math.dist(walker[:2], thing[:2]) - 0.55)
    assert 0.0 <= min(clearances) < 0.03
    x, y = robot.discs()[0, :2]
    assert (x, y) == pytest.approx((2.0 - 0.8 * robot.now(), 0.02), abs=0.05)


def test_two_who_meet_do_not_walk_through_each_other():
    robot = Twin(
        sally(), FAR,
        scene(disc(2.0, 0.0, 0.25, -0.8, 0.0), disc(-2.0, 0.05, 0.25, 0.7, 0.0)),
    )  # fmt: skip
    for _ in range(1200):
        brake(robot, 0.02)
        one, other = robot.discs()
        assert math.dist(one[:2], other[:2]) >= 0.5 - 1e-9
    assert one[0] < -5.0
    assert other[0] > 5.0


@pytest.mark.parametrize("aside", [0.05, 0.3])
@pytest.mark.parametrize("toward", [(0.7, 0.0), (0.0, 0.7)])
def test_movers_brake_for_each_other_within_their_acceleration(aside, toward):
    vx, vy = toward
    robot = Twin(
        sally(), FAR,
        scene(disc(2.0, 0.0, 0.25, -0.8, 0.0), disc(-2.0 * vx, aside - 2.0 * vy, 0.25, vx, vy)),
    )  # fmt: skip
    before = robot.discs()
    for _ in range(600):
        brake(robot, 0.02)
        after = robot.discs()
        for i in range(2):
            change = math.dist(after[i, 2:4], before[i, 2:4])
            assert change <= 1.0 * 0.02 + 0.02  # the latter where it is back on its way
        before = after


def test_attackers_come_through_nothing():
    rng = np.random.default_rng(3)
    bodies = [disc(*rng.uniform(1.0, 4.0, 2), 0.2) for _ in range(5)]
    walls = np.array([[-1.5, -1.0, 1.5, -1.0], [-0.9, -1.5, -0.9, 1.5]])
    runners = [disc(-2.0, -2.0, 0.25, 0.1, 0.0), disc(-3.0, 1.0, 0.25, 0.1, 0.0)]
    robot = Twin(
        sally(), Pose(0.0, 0.0, 0.0), scene(*bodies, *runners, walls=walls.tolist()), seed=5,
        pursuers=Pursuers(np.array([0.0] * 5 + [1.0, 1.0]), 1.3, 5),
    )  # fmt: skip
    met = 0
    for _ in range(1500):
        brake(robot, 0.02)
        things = robot.discs()
        for i in (5, 6):
            for j in set(range(7)) - {i}:
                away = math.dist(things[i, :2], things[j, :2])
                assert away >= things[i, 4] + things[j, 4] - 1e-9
            ends = np.linspace(walls[:, :2], walls[:, 2:], 3001).reshape(-1, 2)
            away = np.hypot(*(ends - things[i, :2]).T).min()
            assert away >= 0.25 - 1e-6
            met += away < 0.26
    assert met > 10


@pytest.mark.parametrize("seed", range(6))
def test_an_attacker_changes_its_velocity_no_faster_than_it_is_assumed_to(seed: int):
    """A wall on its way is no excuse: who walks ahead of the robot and stops dead at a wall is
    nobody that the filter has promised anything about."""
    rng = np.random.default_rng(seed)
    bodies = [disc(*rng.uniform(-2.0, 2.0, 2), 0.2) for _ in range(5)]
    walls = [[-3.0, -3.0, 3.0, -3.0], [3.0, -3.0, 3.0, 3.0], [3.0, 3.0, -3.0, 3.0]]
    runner = disc(-2.5, -2.5, 0.25, 0.1, 0.0)
    robot = Twin(
        sally(), Pose(9.0, 0.0, 0.0), scene(*bodies, runner, walls=walls), seed=seed,
        pursuers=Pursuers(np.array([0.0] * 5 + [1.0]), 1.3, seed),
    )  # fmt: skip
    velocities = []
    for _ in range(1500):
        brake(robot, 0.02)
        velocities.append(robot.discs()[5, 2:4])
    changes = np.hypot(*np.diff(velocities, axis=0).T)
    assert changes.max() <= 1.0 * 0.02 + 1e-9
    assert np.hypot(*np.transpose(velocities)).max() > 0.6  # it does walk


def test_a_person_that_is_hit_is_a_contact_of_a_moving_robot():
    robot = Twin(sally(), obstacles=scene(disc(2.0, 0.0, 0.25, -0.5, 0.0)))
    truth = drive(robot, Twist(0.5, 0.0), 2.0)[-1]
    assert truth.touched >= 1
    assert truth.least_moving <= 0.0


def test_movers_out_of_reach_continue():
    robot = Twin(sally(), obstacles=scene(disc(-3.0, 2.0, 0.25, 1.0, 0.5)))
    clearance = math.hypot(-2.0 + 0.36, 2.5 - 0.29) - 0.25
    assert brake(robot, 1.0).clearance == pytest.approx(clearance, abs=0.01)


def test_a_world_that_physics_can_not_bear_is_refused():
    specks = np.zeros((400, 400), dtype=bool)
    specks[::2, ::2] = True
    with pytest.raises(CohelmError, match=r"40000 boxes and cylinders.*coarser map"):
        Twin(sally(), obstacles=scene(), grid=grid(specks, 0.05, Pose(0.0, 0.0, 0.0)))


def test_a_robot_that_was_tipped_over_is_reported():
    robot = Twin(sally())
    brake(robot, 0.1)
    robot.data.qpos[2] = 0.5
    robot.data.qpos[3:7] = math.cos(0.8), math.sin(0.8), 0.0, 0.0
    robot.wait(robot.now() + 0.1)
    health = robot.read().health
    assert health is not None
    assert "tipped over" in health.faults[0]
