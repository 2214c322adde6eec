"""The generators keep what their descriptions say."""

import math
from pathlib import Path

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose
from cohelm.robot.clearance import disc_clearance
from cohelm.robot.model import RobotModel
from cohelm.scenario.load import robot
from cohelm.scenario.worlds.barn import Barn
from cohelm.scenario.worlds.tracks import Track
from cohelm.sim.world import place
from cohelm.study.campaign import barn, crowd, hands, lab, movers, rooms, suites
from tests.few import first

DATA = Path(__file__).parents[4] / "shared" / "data"
with_data = pytest.mark.skipif(
    not DATA.is_dir(), reason="the shared data are not beside this checkout"
)


@pytest.mark.parametrize("number", range(30))
def test_a_room_can_be_crossed_and_its_walkers_keep_their_bounds(number):
    case = rooms.case(3, number)
    setup, goal = case.setup, case.goal
    assert goal is not None
    n, discs = len(setup.names), np.empty((3000, len(setup.names), 6))
    for k in range(3000):
        place(discs[k], setup.obstacles, 0.04 * k)
    walks = np.array([name.startswith("walker") for name in setup.names])
    assert 2 <= walks.sum() <= 5
    assert 6 <= n - walks.sum() <= 14
    speed = np.hypot(discs[:, walks, 2], discs[:, walks, 3])
    push = np.hypot(*np.diff(discs[:, walks, 2:4], axis=0).transpose(2, 0, 1)) / 0.04
    assert (speed.min(), speed.max() <= rooms.FASTEST + 1e-9) > (0.0, False)
    assert push.max() <= rooms.MAX_ACCELERATION + 1e-6
    clearances = [disc_clearance(setup.start, setup.outline, d[0], d[1], d[4]) for d in discs[0]]
    assert min(clearances) > 0.3
    length, width = setup.obstacles.walls[:, 2].max(), setup.obstacles.walls[:, 3].max()
    still = discs[0, ~walks][:, [0, 1, 4]]
    ends = np.array([setup.start[:2], (goal.x, goal.y)])
    assert rooms.has_way(still, length, width, ends[0], ends[1], 0.5 * rooms.WAY)


def test_a_path_is_invalid_where_it_is_blocked():
    start, goal = np.array([1.2, 3.0]), np.array([8.8, 3.0])
    fence = np.array([(5.0, y, 0.3) for y in np.arange(0.0, 6.1, 0.5)])
    assert not rooms.has_way(fence, 10.0, 6.0, start, goal, 0.5)
    assert rooms.has_way(fence[:8], 10.0, 6.0, start, goal, 0.5)


def test_cases_depend_on_seed_and_number_only():
    a, b, c = rooms.case(1, 7), rooms.case(1, 7), rooms.case(2, 7)
    assert a.setup.obstacles.discs.tolist() == b.setup.obstacles.discs.tolist()
    assert a.setup.obstacles.discs.tolist() != c.setup.obstacles.discs.tolist()


def test_the_first_drive_in_the_lab_is_the_scenario_as_shipped():
    base = lab.scenario()
    assert base.start is not None
    first, other = lab.case(base, 1, 0), lab.case(base, 1, 1)
    assert first.setup.start == (base.start.x_m, base.start.y_m, base.start.heading_rad)
    assert other.setup.start != first.setup.start
    assert math.dist(other.setup.start[:2], first.setup.start[:2]) < 0.15


def test_no_person_appears_within_ten_seconds_of_the_first_sample():
    t = 0.4 * np.arange(20)
    track = Track("a", 100.0 + t, np.column_stack((1.2 * t, 0.1 * np.sin(t))))
    walks = crowd.crowd("scene", [track]).walks
    assert walks[0].first == pytest.approx(100.0 - crowd._ON - 1.0)
    path = crowd.walked(track)
    knots, ends = path.knots, []
    for s in (1.0, 1.0 + crowd._ON, knots[-1] - 1.0 - 1e-9):
        m = crowd.evaluate(path.knots, path.coeffs, s)
        ends.append((m.x, m.vx))
    assert ends[0][0] == pytest.approx(ends[1][0] - crowd._ON * ends[1][1], abs=1e-6)
    assert ends[1][0] == pytest.approx(0.0, abs=0.2)
    assert ends[2][0] == pytest.approx(1.2 * t[-1] + 12.0, abs=0.5)


def test_no_person_appears_within_reach_of_a_crossing():
    t = 0.4 * np.arange(200)
    walker = Track("walker", t, np.column_stack((1.0 * t - 40.0, 0.0 * t)))
    late = 40.0 + 0.4 * np.arange(20)
    stays = Track("stays", late, np.column_stack((0.01 * late, 0.0 * late)))
    first = Track("first", t[:20] - 20.0, np.column_stack((0.01 * t[:20], 1.0 + 0.0 * t[:20])))
    made = crowd.crowd("s", [walker, stays, first])
    assert [w.name for w in made.walks] == ["walker", "first"]  # he is there before all crossings
    (said,) = made.left_out
    assert said.startswith("s, person stays: would come into being ")


@pytest.mark.parametrize("number", range(9))
def test_a_field_of_movers_keeps_its_bounds(number):
    case = movers.case(5, number)
    setup = case.setup
    n = len(setup.names)
    assert (case.kind, n) == list(movers.DENSITIES.items())[number % 3]
    discs = np.empty((4550, n, 6))
    for k in range(len(discs)):
        place(discs[k], setup.obstacles, 0.02 * k)
    speed = np.hypot(discs[..., 2], discs[..., 3])
    push = np.hypot(*np.diff(discs[..., 2:4], axis=0).transpose(2, 0, 1)) / 0.02
    assert 1.0 < speed.max() <= movers.FASTEST + 1e-9
    assert push.max() <= movers.MAX_ACCELERATION + 1e-6
    step = np.hypot(*np.diff(discs[..., :2], axis=0).transpose(2, 0, 1)).max()
    assert step <= 0.02 * movers.FASTEST + 1e-9  # nobody jumps
    r = discs[..., 4]
    assert (0.25 <= r).all()
    assert (r <= 0.5).all()
    assert (discs[..., 0] - r).min() >= movers.APRON - 1e-9
    assert (discs[..., 0] + r).max() <= movers.LENGTH - movers.APRON + 1e-9
    assert (discs[..., 1] - r).min() >= 0.1 - 1e-9
    assert (discs[..., 1] + r).max() <= movers.WIDTH - 0.1 + 1e-9


def test_running_pedestrians_are_left_out_and_listed():
    t = 0.4 * np.arange(20)
    runner = Track("fast", t, np.column_stack((4.0 * t, 0.0 * t)))
    once = Track("once", t[:1], np.zeros((1, 2)))
    walker = Track("slow", t, np.column_stack((1.0 * t, 0.0 * t)))
    made = crowd.crowd("s", [runner, once, walker])
    assert [w.name for w in made.walks] == ["slow"]
    assert made.left_out == ("s, person fast: up to 4.0 m/s", "s, person once: seen only once")


@with_data
@pytest.mark.parametrize(  # crowd has much to read
    "name", first(sorted(suites.NAMES, key="crowd".__eq__), len(suites.NAMES) - 1)
)
def test_every_suite_makes_the_same_episode_after_pickling(name):
    import pickle

    made = suites.suite(name, 4, DATA)
    sent = pickle.loads(pickle.dumps(made))
    for number in (0, 1, 8):
        a, b = made.case(number), sent.case(number)
        # by their words, in which NaN is NaN: from Python 3.13 on a dataclass with one equals none
        assert repr((a.setup.start, a.kind, a.goal)) == repr((b.setup.start, b.kind, b.goal))
        assert a.setup.obstacles.discs.tobytes() == b.setup.obstacles.discs.tobytes()
        assert a.setup.recorded_stick.x.tobytes() == b.setup.recorded_stick.x.tobytes()


def test_data_that_a_suite_does_not_use_is_reported(tmp_path):
    made = suites.suite("random", 1, tmp_path)
    assert made.notes == ("the recordings of --data: random drives on none",)
    assert suites.suite("random", 1, None).notes == ()


def test_a_barn_episode_names_the_robot_whose_outline_it_drives():
    path = np.array([[0.0, 1.0], [0.0, 9.0]])
    world = Barn(7, np.empty((0, 6)), np.empty((0, 4)), path, Pose(0, 0, 1.57), (0, 10), 1, 100)
    made = barn.case((world,), 4, 0)
    assert made.robot == robot("jackal")
    assert np.array_equal(made.setup.outline, made.robot.outline)


@pytest.mark.parametrize("name", ["random", "movers", "adversary"])
def test_another_robot_drives_with_its_own_outline_and_limits(name):
    husky = robot("husky")
    case = suites.suite(name, 4, None, robot=husky).case(1)
    assert case.robot == husky
    assert np.array_equal(case.setup.outline, husky.outline)
    assert case.setup.limits == husky.bounds()


@pytest.mark.parametrize("name", ["random", "movers"])
def test_for_a_slow_robot_the_reference_is_slowed_down_and_the_limit_grows_as_much(name):
    burger, sally = robot("turtlebot3_burger"), robot("sally")
    slow, usual = (suites.suite(name, 4, None, robot=one).case(0).setup for one in (burger, sally))
    assert slow.gains.u_d == pytest.approx(0.8 * 0.22)
    assert slow.duration == pytest.approx(usual.duration * usual.gains.u_d / slow.gains.u_d)


@pytest.mark.parametrize("name", ["random", "movers"])
def test_sally_named_drives_the_very_same_episodes(name):
    named = suites.suite(name, 4, None, robot=robot("sally")).case(2).setup
    usual = suites.suite(name, 4, None).case(2).setup
    assert (named.start, named.duration) == (usual.start, usual.duration)
    assert named.obstacles.discs.tobytes() == usual.obstacles.discs.tobytes()


def test_a_room_for_a_larger_robot_has_a_wider_way():
    husky = robot("husky")
    case = suites.suite("random", 4, None, robot=husky).case(0)
    larger = husky.reach - robot("sally").reach
    assert case.setup.start.x == pytest.approx(1.2 + larger)
    discs = case.setup.obstacles.discs
    resting = discs[: sum(name.startswith("disc") for name in case.setup.names)]
    away = np.hypot(resting[:, 0] - case.setup.start.x, resting[:, 1] - case.setup.start.y)
    assert (away - resting[:, 4]).min() > 0.9 + larger


@pytest.mark.parametrize(
    ("name", "plant", "model", "words"),
    [
        ("barn", None, "husky", "own robot: --robot goes with random, movers, adversary"),
        ("random", "twin", "husky", "husky has no lidar, which --plant twin needs"),
    ],
)
def test_a_robot_that_can_not_drive_a_suite_is_refused_with_the_reason(name, plant, model, words):
    with pytest.raises(CohelmError, match=words):
        suites.suite(name, 1, None, plant, robot(model))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"footprint_m": [[1.2, 0.3], [-1.2, 0.3], [-1.2, -0.3], [1.2, -0.3]]}, "too large"),
        ({"limits": {"speed_mps": 0.01, "wheel_acceleration_mps2": 1.0}}, "too slow"),
        ({"limits": {"speed_mps": 1.0, "acceleration_mps2": 1.0}}, "how hard the robot brakes"),
    ],
)
def test_a_robot_that_no_room_fits_is_refused(change, words):
    given = robot("husky").model_dump() | change
    with pytest.raises(CohelmError, match=words):
        suites.suite("random", 1, None, robot=RobotModel.model_validate(given))


@with_data
def test_a_robot_that_sees_too_short_for_its_brakes_drives_on_true_obstacles_only():
    sally = robot("sally")
    short = sally.lidar.model_copy(update={"range_max_m": 0.5})
    model = sally.model_copy(update={"lidar": short})
    suites.suite("random", 1, None, robot=model)
    with pytest.raises(CohelmError, match=r"from 1 m/s stops after .* set limits\.speed_mps to"):
        suites.suite("random", 1, None, "twin", model)


def test_all_recorded_sticks_are_found_and_other_files_are_reported():
    found = hands.read(DATA)
    assert len(found.recordings) == len(found.names) == 12
    assert any("f1tenth" in said for said in found.left_out)


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("randon", None, "did you mean random"),
        ("barn", None, "--data"),
        ("barn", "nowhere", "no such folder"),
        ("barn", ".", "worlds.json"),
        ("crowd", ".", "CSV"),
        ("hands", ".", "stick"),
    ],
)
def test_a_suite_that_can_not_be_made_is_reported_with_the_cure(name, data, words, tmp_path):
    given = None if data is None else tmp_path / data
    with pytest.raises(CohelmError, match=words):
        suites.suite(name, 1, given)
