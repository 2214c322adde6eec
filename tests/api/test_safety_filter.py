"""The safety filter as a library: nothing is hit, nothing wrong gets in, nothing compiles late."""

import math
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from cohelm.core.errors import CohelmError
from cohelm.core.obstacles import Obstacles
from cohelm.core.types import Pose, Twist
from cohelm.law.verdict import Verdict
from cohelm.pilot import safety_filter
from cohelm.pilot.margin_inflation import SLOP
from cohelm.pilot.safety_filter import LimitingObstacle, SafetyFilter
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import Limits
from tests.api.attacks import HERE, attacked, model
from tests.few import first

DT = 0.02
REST = Twist(0.0, 0.0)
AHEAD = Twist(1.0, 0.0)
NOTHING = Obstacles()
SALLY = model("sally", 0.0)
PROMISED = 0.5 * 0.015 + SLOP
"""Half of the hard margin as it is inflated."""
EACH = [
    ("sally", 0.0, 0.02), ("sally", 0.007, 0.013), ("sally", 0.02, 0.033), ("sally", 0.05, 0.02),
    ("jackal", 0.0, 0.013), ("jackal", 0.007, 0.033), ("jackal", 0.02, 0.02),
    ("jackal", 0.05, 0.013),
]  # fmt: skip
"""Of all drives of robot, delay and period: each delay with each robot, each period with either."""


DRIVES = sorted(
    product(["sally", "jackal"], [0.0, 0.007, 0.02, 0.05], [0.02, 0.013, 0.033]),
    key=lambda drive: drive not in EACH,
)


@pytest.mark.parametrize(("name", "delay", "period"), first(DRIVES, len(EACH)))
def test_no_command_lets_a_robot_reach_a_static_obstacle(name, delay, period):
    for seed in range(3):
        got = attacked(name, seed, delay, period)
        assert got.least >= PROMISED, seed
        assert got.driven > 0.5, seed


@pytest.mark.parametrize("name", ["sally", "jackal"])
def test_no_command_reaches_a_static_obstacle_with_a_noisy_twist(name):
    for seed in range(3):
        assert attacked(name, seed, 0.05, DT, noise=0.03).least >= PROMISED, seed


@pytest.mark.parametrize(
    ("name", "delay"),
    first(
        [
            ("sally", 0.0), ("jackal", 0.007), ("sally", 0.05),
            ("jackal", 0.0), ("sally", 0.007), ("jackal", 0.05),
        ],
        3,
    ),
)  # fmt: skip
def test_no_command_reaches_a_static_obstacle_with_irregular_calls(name, delay):
    for seed in range(3):
        got = attacked(name, seed, delay, DT, uneven=True)
        assert got.least >= PROMISED, seed
        assert got.driven > 0.5, seed


@pytest.mark.parametrize(("name", "late"), [("sally", 2.0), ("jackal", 5.0), ("sally", 10.0)])
def test_no_command_reaches_a_static_obstacle_where_every_call_is_said_to_be_late(name, late):
    for seed in range(3):
        got = attacked(name, seed, 0.05, DT, late=late)
        assert got.least >= PROMISED, seed
        assert got.driven > 0.5, seed


@pytest.mark.parametrize("delay", [0.0, 0.03, 0.05])
def test_a_command_is_worked_out_for_where_it_takes_effect_however_calls_come(delay):
    """At a steady speed that is so far ahead as the robot goes in the delay, and half a period."""
    made, rng = model("sally", delay), np.random.default_rng(1)
    safe = SafetyFilter(made, DT)
    x, after = 0.0, DT
    for _ in range(50):
        seen = Obstacles(points=[[x + 0.56, 0.0]])
        got = safe(Pose(x, 0.0, 0.0), Twist(0.5, 0.0), Twist(0.5, 0.0), seen, after)
        assert got.twist.v == pytest.approx(0.5)
        there = 0.56 - 0.36 - 0.5 * (delay + 0.5 * DT)
        assert got.clearance == pytest.approx(there, abs=1e-9)
        after = rng.uniform(0.2, 1.0) * DT
        x += 0.5 * after


def test_a_command_that_was_soon_superseded_does_not_count_as_reached():
    """Told to brake twice within a millisecond, the wheels have not braked for two periods."""
    safe = SafetyFilter(model("sally", 0.0), DT)
    for _ in range(3):
        safe(HERE, AHEAD, AHEAD, NOTHING)
    braked = [safe(HERE, AHEAD, REST, NOTHING, after).twist.v for after in (DT, 0.001)]
    assert braked[0] == pytest.approx(1.0 - 2.0 * DT)
    assert braked[1] == pytest.approx(1.0 - 2.0 * (DT + 0.001))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sally", "jackal"])
def test_no_command_lets_a_robot_reach_a_static_obstacle_in_many_drives(name):
    for seed in range(100, 300):
        delay, period = (seed % 7) * 0.015, 0.01 + 0.007 * (seed % 5)
        assert attacked(name, seed, delay, period).least >= PROMISED, seed


def test_the_first_call_accepts_a_robot_that_already_moves():
    rolls = Twist(1.0, 0.0)
    assert SafetyFilter(SALLY, DT)(HERE, rolls, AHEAD, NOTHING).twist.v == pytest.approx(1.0)
    got = SafetyFilter(SALLY, DT)(HERE, rolls, AHEAD, Obstacles(points=[[0.6, 0.0]]))
    assert got.verdict == Verdict.BRAKING
    assert got.twist.v == pytest.approx(1.0 - 2.0 * DT)


def test_wheels_that_do_not_follow_are_believed_after_a_while():
    safe = SafetyFilter(SALLY, DT)
    # told to go, something holds it
    held = [safe(HERE, REST, AHEAD, NOTHING).twist.v for _ in range(50)]
    assert max(held) <= 0.2 + 9 * 2.0 * DT
    safe.reset()
    for _ in range(7):
        told = safe(HERE, REST, AHEAD, NOTHING).twist.v
    assert told == pytest.approx(7 * 2.0 * DT)


def test_the_filter_continues_from_the_command_that_was_sent():
    safe = SafetyFilter(SALLY, DT)
    for _ in range(10):
        safe(HERE, REST, AHEAD, NOTHING)
        safe.sent(REST)
    assert safe(HERE, REST, AHEAD, NOTHING).twist.v == pytest.approx(2.0 * DT)
    with pytest.raises(CohelmError, match="finite"):
        safe.sent(Twist(math.nan, 0.0))


@pytest.mark.parametrize("sent", [Twist(1000.0, 0.0), Twist(0.0, -90.0)])
def test_a_sent_command_in_other_units_is_refused(sent):
    with pytest.raises(CohelmError, match="in m/s and rad/s, got"):
        FILTER.sent(sent)


@pytest.mark.parametrize(
    "measured", [Twist(300.0, 0.0), Twist(-8.0, 0.0), Twist(0.3, 45.0), Twist(0.3, -1e308)]
)
def test_a_measured_twist_that_no_such_robot_has_stops_it_within_its_limits(measured):
    """As in mm/s or deg/s, or with a broken encoder."""
    safe = SafetyFilter(SALLY, DT)
    assert safe(HERE, measured, AHEAD, NOTHING)[:2] == (REST, Verdict.INVALID)
    safe.reset()
    for _ in range(20):
        v = safe(HERE, Twist(0.5, 0.0), AHEAD, NOTHING).twist.v
    for _ in range(40):
        got = safe(HERE, measured, AHEAD, NOTHING)
        assert got.verdict == Verdict.INVALID
        assert max(v - 2.0 * DT, 0.0) == pytest.approx(got.twist.v)
        v = got.twist.v
    assert got.twist == REST


@pytest.mark.parametrize("measured", [Twist(math.inf, 0.0), Twist(0.0, -math.inf)])
def test_an_infinite_twist_is_none_also_without_limits_of_speed(measured):
    limits = Limits(math.inf, 2.0, math.inf, 6.0)
    safe = SafetyFilter(SALLY, DT, limits=limits, delay=0.1)
    assert safe(HERE, measured, AHEAD, NOTHING)[:2] == (REST, Verdict.INVALID)
    assert safe(HERE, REST, Twist(0.02, 0.0), NOTHING).verdict == Verdict.UNTOUCHED


@pytest.mark.parametrize("after", [-0.01, math.nan])
def test_a_clock_that_goes_back_brakes(after):
    safe = SafetyFilter(SALLY, DT)
    for _ in range(20):
        v = safe(HERE, Twist(0.5, 0.0), AHEAD, NOTHING).twist.v
    got = safe(HERE, Twist(0.5, 0.0), AHEAD, NOTHING, after)
    assert got.verdict == Verdict.INVALID
    assert got.twist.v < v


@pytest.mark.parametrize(
    ("seen", "limiting"),
    [
        (Obstacles(points=[[9, 9], [0.45, 0]]), LimitingObstacle("point", 1)),
        (Obstacles(discs=[[0.55, 0, 0.1]], points=[[9, 9]]), LimitingObstacle("disc", 0)),
        (
            Obstacles(discs=[[9, 9, 1]], segments=[[9, 9, 8, 9], [0.45, -1, 0.45, 1]]),
            LimitingObstacle("segment", 1),
        ),
    ],
)
def test_what_holds_the_robot_back_is_named(seen, limiting):
    got = SafetyFilter(SALLY, DT)(HERE, REST, Twist(1.0, 0.0), seen)
    for _ in range(30):
        got = SafetyFilter(SALLY, DT)(HERE, Twist(0.4, 0.0), AHEAD, seen)
    assert got.limiting == limiting
    assert got.clearance == pytest.approx(0.09 - 0.4 * DT / 2, abs=1e-6)
    assert SafetyFilter(SALLY, DT)(HERE, REST, Twist(0.01, 0.0), seen).limiting is None


BAD = st.sampled_from([math.nan, math.inf, -math.inf, 1e308, 0.0, 0.3])


@settings(max_examples=300)
@given(st.lists(st.tuples(*[BAD] * 7), min_size=1, max_size=5), BAD)
def test_no_number_makes_it_raise_or_return_nan(calls, corner):
    seen = Obstacles(points=[[corner, 0.0]], discs=[[corner, 0.0, 0.1]])
    safe = FILTER
    safe.reset()
    for x, y, psi, v, omega, want_v, want_omega in calls:
        got = safe(Pose(x, y, psi), Twist(v, omega), Twist(want_v, want_omega), seen)
        assert all(math.isfinite(speed) for speed in got.twist)
        bad = not all(map(math.isfinite, (x, y, psi, v, omega, want_v, want_omega, corner)))
        assert bad <= (got.verdict == Verdict.INVALID)
        assert got.verdict in Verdict


FILTER = SafetyFilter(SALLY, DT)


@pytest.mark.parametrize("broken", range(3))
def test_a_number_that_is_none_brakes_a_moving_robot_to_a_stand(broken):
    """Within its limits, as fast as it can."""
    nan = (Pose(math.nan, 0.0, 0.0), Twist(math.nan, 0.0), Twist(math.nan, 0.0))
    safe, v, pose = SafetyFilter(SALLY, DT), 0.0, HERE
    for _ in range(30):
        v = safe(pose, Twist(v, 0.0), AHEAD, NOTHING).twist.v
        pose = arc(pose, Twist(v, 0.0), DT)
    assert v == pytest.approx(1.0)
    for _ in range(26):
        given = [pose, Twist(v, 0.0), AHEAD]
        given[broken] = nan[broken]
        got = safe(*given, NOTHING)
        assert got.verdict == Verdict.INVALID
        assert v - 2.0 * DT - 1e-9 <= got.twist.v <= v
        v = got.twist.v
    assert got.twist == REST


def test_a_beam_that_hit_nothing_is_no_obstacle_and_a_broken_disc_is():
    safe = SafetyFilter(SALLY, DT)
    beams = Obstacles(points=[[math.nan, math.nan], [math.inf, 0.0]])
    assert safe(HERE, REST, Twist(0.01, 0.0), beams).verdict == Verdict.UNTOUCHED
    for bad in (Obstacles(discs=[[math.nan, 0, 1]]), Obstacles(segments=[[0, math.nan, 1, 1]])):
        assert safe(HERE, REST, AHEAD, bad).verdict == Verdict.INVALID


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ((None, REST, AHEAD, NOTHING), "pose"),
        ((HERE, REST, None, NOTHING), "nominal"),
        ((HERE, 0.3, AHEAD, NOTHING), "twist"),
        (((0.0, 0.0), REST, AHEAD, NOTHING), "pose"),
        ((HERE, REST, ("fast", 0.0), NOTHING), "nominal"),
        (((10**400, 0.0, 0.0), REST, AHEAD, NOTHING), "pose"),
        ((HERE, REST, AHEAD, NOTHING, "soon"), "after is the time since the last call in seconds"),
        ((HERE, REST, AHEAD, None), "obstacles must be cohelm.Obstacles"),  # a scan that is missing
        ((HERE, REST, AHEAD, np.zeros((3, 2))), "obstacles must be cohelm.Obstacles"),
        ((HERE, REST, AHEAD, [[1.0, 2.0]]), "obstacles must be cohelm.Obstacles"),
    ],
)
def test_calls_without_pose_twist_or_obstacles_are_refused_with_the_reason(given, said):
    with pytest.raises(CohelmError, match=said):
        FILTER(*given)


def test_obstacles_can_not_be_forgotten():
    with pytest.raises(TypeError, match=r"missing .* 'obstacles'"):
        FILTER(HERE, REST, AHEAD)  # pyright: ignore[reportCallIssue]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"robot": "sally"}, "must be a cohelm.RobotModel, got 'sally'"),
        ({"period": 20}, "period must be from 0.001 to 1 s, got 20"),
        ({"period": math.nan}, "period must be from 0.001 to 1"),
        ({"period": "fast"}, "period must be a number"),
        ({"period": "0.02"}, "period must be a number, got '0.02'"),
        ({"period": True}, "period must be a number, got True"),
        ({"delay": False}, "delay must be a number, got False"),
        ({"delay": -0.01}, "delay must be from 0 to 2"),
        ({"delay": math.nan}, "delay must be from 0 to 2"),
        ({"lag": 3.0}, "lag must be from 0 to 1"),
        ({"position_error": -1.0}, "position_error must be from 0 to 1"),
        ({"hard_margin": 0.0}, "hard_margin must be greater than 0"),
        ({"hard_margin": 0.1}, "hard_margin must not exceed soft_margin"),
        ({"deceleration_fraction": 0.0}, "deceleration_fraction must be a share"),
        ({"steer_weight": math.nan}, "steer_weight must be greater than 0"),
        ({"limits": Limits(1.0, math.nan, 1.0, 1.0, 1.0, 1.0, 0.5)}, "limits.acceleration must"),
        (
            {"limits": Limits(1.0, 1e6, 1.0, 1.0, 1.0, 1.0, 0.5)},
            r"acceleration is in m/s\^2 and at most 100",
        ),
        (
            {"limits": Limits(1.0, 1.0, 31.0, 1.0, 1.0, 1.0, 0.5)},
            "yaw_rate is in rad/s and at most 30",
        ),
        (
            {"limits": Limits(1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 50.0)},
            "limits.track is in m and at most 20",
        ),
        ({"limits": Limits(*[math.inf] * 6, 0.5)}, "how hard the robot brakes"),
        ({"limits": Limits(1.0, 1.0, 1.0, *[math.inf] * 3, 0.5)}, "how hard the robot brakes"),
    ],
)
def test_no_filter_is_made_that_could_promise_nothing(given, said):
    with pytest.raises(CohelmError, match=said):
        SafetyFilter(**({"robot": SALLY, "period": DT} | given))


@pytest.mark.parametrize("sent", [None, "fast", 0.3, (0.1, 0.2, 0.3), (math.nan, 0.0)])
def test_a_sent_command_must_be_a_twist(sent):
    with pytest.raises(CohelmError, match="twist"):
        FILTER.sent(sent)


def test_no_kind_of_number_or_array_is_compiled_for_anew():
    """A compilation in the loop would take seconds."""
    before = len(safety_filter._filtered.signatures)
    locked = np.array([[1.0, 0.0], [2.0, 1.0]])
    locked.flags.writeable = False
    for points in (
        [[1, 0], [2, 1]],
        locked,
        locked.astype(np.float32),
        np.asfortranarray(locked),
        np.array([[0, 1, 0], [0, 2, 1]])[:, 1:],
        np.array([[0, 1, 0], [0, 2, 1]], dtype=">f8")[:, 1:],
        [],
    ):
        seen = Obstacles(points=points, discs=[[5, 5, 1]])
        for pose in ((0, 0, 0), (np.float32(0.0), 0, np.int64(0)), np.zeros(3)):
            FILTER(pose, (0, np.float32(0)), np.zeros(2, dtype=np.int8), seen)
    assert len(safety_filter._filtered.signatures) == before == 1


@given(
    st.lists(st.tuples(*[st.floats(-3, 3)] * 2), max_size=5),
    st.tuples(*[st.floats(-3, 3)] * 2, st.floats(-7, 7)),
)
def test_obstacles_of_the_body_frame_are_the_same_in_any_other(points, at):
    """Moved with the robot, they hold it back alike."""
    pose = Pose(*at)
    discs = [[x, y, 0.1, 0.3, -0.2] for x, y in points[:2]]
    walls = [[*a, *b] for a, b in pairwise(points)]
    seen = Obstacles(points=points, discs=discs, segments=walls)
    FILTER.reset()
    here = FILTER(HERE, Twist(0.3, 0.1), Twist(0.8, 0.4), seen)
    FILTER.reset()
    there = FILTER(pose, Twist(0.3, 0.1), Twist(0.8, 0.4), seen.placed(pose))
    assert here.clearance == pytest.approx(there.clearance, abs=1e-9)
    assert len(seen) == len(points) + len(discs) + len(walls)


def test_a_scan_becomes_the_points_it_hit():
    ranges = [1.0, math.inf, -math.inf, math.nan, 2.0]
    mount = Pose(0.3, 0.1, math.pi / 2)
    seen = Obstacles.from_ranges(ranges, -math.pi / 2, math.pi / 4, mount=mount, range_min=0.1)
    assert seen.points == pytest.approx(np.array([[1.3, 0.1], [0.3, 0.2], [-1.7, 0.1]]), abs=1e-9)


def test_returns_below_the_minimum_range_count_at_the_minimum_range():
    seen = Obstacles.from_ranges([0.0, 0.05, -1.0, -math.inf], 0.0, 0.1, range_min=0.1)
    assert np.hypot(*seen.points.T) == pytest.approx(0.1)


@pytest.mark.parametrize(
    "angles", [(-135.0, 0.375), (-2.36, 0.375), (math.nan, 0.006), (0.0, math.inf)]
)
def test_angles_in_degrees_are_no_scan(angles):
    with pytest.raises(CohelmError, match="give radians"):
        Obstacles.from_ranges(np.ones(720), *angles)


def test_ranges_in_millimetres_are_no_scan():
    ranges = np.array([450.0, 1200.0, 3000.0, math.inf])
    with pytest.raises(CohelmError, match="ranges are in metres, got 1200 in the median"):
        Obstacles.from_ranges(ranges, 0.0, 0.1)
    with pytest.raises(CohelmError, match="centimetres by 100"):
        Obstacles.from_ranges(0.25 * ranges, 0.0, 0.1)
    assert len(Obstacles.from_ranges([0.4, 1.2, 655.35], 0.0, 0.1)) == 3  # one wild range is none


@pytest.mark.parametrize("range_min", [60.0, -0.1, math.nan])
def test_a_minimum_range_in_millimetres_does_not_move_obstacles_away(range_min):
    with pytest.raises(CohelmError, match="range_min is in metres, from 0 to 10"):
        Obstacles.from_ranges([0.5] * 9, 0.0, 0.1, range_min=range_min)


@pytest.mark.parametrize("ranges", [None, [], np.empty(0)])
def test_a_scan_that_did_not_come_is_not_free_space(ranges):
    with pytest.raises(CohelmError, match="no scan has come"):
        Obstacles.from_ranges(ranges, 0.0, 0.1)


@pytest.mark.parametrize("ranges", [[math.nan] * 720, np.full(2, math.nan)])
def test_a_scan_that_measured_nothing_is_not_free_space(ranges):
    with pytest.raises(CohelmError, match="all ranges are NaN"):
        Obstacles.from_ranges(ranges, -math.pi, 0.0087)


def test_beams_that_all_look_the_same_way_are_no_scan():
    with pytest.raises(CohelmError, match="goes round once"):
        Obstacles.from_ranges(np.ones(720), 0.0, 0.0)
    assert len(Obstacles.from_ranges([1.0], 0.0, 0.0)) == 1


@pytest.mark.parametrize("angles", [("a", 0.1), (None, 0.1), (0.0, None)])
def test_angles_that_are_no_numbers_are_said(angles):
    with pytest.raises(CohelmError, match="angle_min, angle_increment and range_min are numbers"):
        Obstacles.from_ranges(np.ones(7), *angles)


@pytest.mark.parametrize("at", [Pose(math.nan, 0.0, 0.0), Pose(0.0, math.inf, 0.0)])
def test_obstacles_placed_nobody_knows_where_are_not_free_space(at):
    with pytest.raises(CohelmError, match="which is no place: stop the robot"):
        Obstacles(points=[[0.6, 0.0]]).placed(at)


@pytest.mark.parametrize("at", [None, (1.0, 2.0), "here"])
def test_what_is_no_pose_to_place_obstacles_at_is_said(at):
    with pytest.raises(CohelmError, match="placed takes a"):
        Obstacles(points=[[0.6, 0.0]]).placed(at)


@pytest.mark.parametrize(
    "mount", [(0.2, 0.0), None, Pose(0.2, 0.0, 45.0), Pose(200.0, 0.0, 0.0), Pose(math.nan, 0, 0)]
)
def test_what_is_no_mount_is_said(mount):
    with pytest.raises(CohelmError, match="mount "):
        Obstacles.from_ranges([1.0], 0.0, 0.1, mount=mount)


@pytest.mark.parametrize("turn", [1, -1])
def test_a_full_turn_in_float32_is_a_scan_either_way(turn):
    step = turn * np.float32(2 * math.pi / 719)
    assert len(Obstacles.from_ranges(np.ones(720), -turn * math.pi, float(step))) == 720


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"points": [1.0, 2.0]}, "points need 2 columns"),
        ({"points": np.zeros((3, 3))}, "points need 2 columns"),
        ({"points": "here"}, "points must be an array of numbers"),
        ({"points": [[1.0], [1.0, 2.0]]}, "points must be an array of numbers"),
        ({"segments": np.zeros((3, 2))}, "segments need 4 columns"),
        ({"discs": np.zeros((3, 4))}, "discs need rows"),
        ({"discs": [[0.0, 0.0, -1.0]]}, "radius must not be negative"),
        ({"discs": [[0.0, 0.0, 1.0]], "max_acceleration": [1.0, 2.0]}, "max_acceleration needs"),
        ({"discs": [[0.0, 0.0, 1.0]], "max_acceleration": -1.0}, "max_acceleration needs"),
        ({"discs": [[0.0, 0.0, 1.0]], "velocity_error": [0.1, 0.1]}, "velocity_error needs"),
        ({"discs": [[0.0, 0.0, 1.0]], "velocity_error": -0.1}, "velocity_error needs"),
        ({"velocity_error": [0.1, 0.2]}, "velocity_error needs a number >= 0 for each of 0 discs"),
    ],
)
def test_no_array_of_the_wrong_shape_or_kind_passes_for_obstacles(given, said):
    with pytest.raises(CohelmError, match=said):
        Obstacles(**given)


def test_a_mover_of_uncertain_speed_is_kept_farther_off():
    """A robot at 0.5 m/s, somebody who walks alongside: well, or with a velocity that is hardly
    known."""
    beside = [[0.6, 0.55, 0.2, 0.5, 0.0]]
    known, guessed = (
        SafetyFilter(SALLY, DT)(
            HERE, Twist(0.5, 0.0), Twist(0.5, 0.0), Obstacles(discs=beside, velocity_error=off)
        )
        for off in (0.0, 1.0)
    )
    assert known.twist == Twist(0.5, 0.0)
    assert guessed.twist.v < 0.5
    assert guessed.limiting == LimitingObstacle("disc", 0)


def test_another_outline_counts_from_the_next_call_on():
    safe = SafetyFilter(SALLY, DT)
    seen = Obstacles(points=[[1.0, 0.0]])
    before = safe(HERE, REST, AHEAD, seen)
    safe.reset()
    safe.reshape([[0.95, 0.2], [-0.3, 0.2], [-0.3, -0.2], [0.95, -0.2]])
    after = safe(HERE, REST, AHEAD, seen)
    assert after.clearance == pytest.approx(0.05, abs=0.02)
    assert after.clearance < before.clearance
    with pytest.raises(CohelmError, match="dent"):
        safe.reshape([[0.3, 0.2], [0.0, 0.0], [-0.3, 0.2], [-0.3, -0.2], [0.3, -0.2]])
