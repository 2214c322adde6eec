"""One robot, fully recorded: what the record says is what happened."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings, strategies as st

from cohelm.core.trace import Trace
from cohelm.core.types import Pose, Twist, disc
from cohelm.law.gains import Gains
from cohelm.law.reference import through
from cohelm.robot.kinematics import arc
from cohelm.sim.operator_model import OperatorModel, replay
from cohelm.sim.run import pieces, run
from cohelm.sim.world import Body, world
from tests.oracle import lab
from tests.robot.test_footprint import polygon, signed
from tests.sim.runs import SALLY, WALLS, lab_run, lab_world

ALL_AT_ONCE = lab_run(
    operator=OperatorModel(active=True, tremor=0.05), seed=7, limits=SALLY, delay=0.13,
    obstacles=lab_world(WALLS), duration=8.0,
)  # fmt: skip
"""Person, trembling, wheel limits, delay, walls and a mover together."""


def same(one, other):
    """Bit by bit, so that NaN equals NaN and -0 differs from 0."""
    return all(
        getattr(one, part).tobytes() == getattr(other, part).tobytes()
        for part in ("rows", "h", "discs")
    )


@pytest.fixture(scope="module")
def busy():
    return run(ALL_AT_ONCE)


def test_the_record_has_one_row_per_control_step_from_0_to_the_end(busy):
    assert len(busy) == ALL_AT_ONCE.steps == 801
    assert busy.rows["t"] == pytest.approx(np.arange(801) * 0.01, abs=0.0)
    assert (busy.h.shape, busy.discs.shape) == ((801, 4), (801, 4, 6))
    assert len(run(lab_run(None))) == math.floor(58.742640687 / 0.01) + 1


@given(st.integers(1, 900))
@settings(max_examples=20)
def test_a_run_in_pieces_of_any_length_is_the_same_run(length):
    whole = run(ALL_AT_ONCE)
    parts = list(pieces(ALL_AT_ONCE, length))
    joined = parts[0]
    for part in parts[1:]:
        joined = Trace.joined(joined, part)
    assert same(joined, whole)
    assert {len(part) for part in parts[:-1]} <= {length}


def test_the_same_setup_gives_the_same_run_to_the_last_bit(busy):
    assert same(run(ALL_AT_ONCE), busy)


def test_each_pose_is_the_last_one_moved_by_what_the_wheels_did(busy):
    rows = busy.rows
    for k in range(0, len(rows) - 1, 13):
        row, after = rows[k], rows[k + 1]
        told = arc(
            Pose(row["x"], row["y"], row["psi"]),
            Twist(row["applied_v"], row["applied_omega"]),
            0.01,
        )
        assert told == pytest.approx((after["x"], after["y"], after["psi"]), abs=1e-12)


def test_h_is_counted_from_the_robots_centre_for_every_disc(busy):
    rows = busy.rows
    clearance = np.hypot(
        busy.discs[:, :, 0] - rows["x"][:, None], busy.discs[:, :, 1] - rows["y"][:, None]
    )
    assert busy.h == pytest.approx(clearance**2 - busy.discs[:, :, 5] ** 2, abs=1e-9)
    assert rows["h"] == pytest.approx(busy.h.min(axis=1), abs=1e-9)


def test_clearance_is_that_of_the_real_outline_to_the_nearest_disc_or_wall(busy):
    """E7, against shapely."""
    walls = [shapely.LineString(w.reshape(2, 2)) for w in WALLS]
    for k in range(0, len(busy), 40):
        row = busy.rows[k]
        shape = polygon(lab.SALLY, Pose(row["x"], row["y"], row["psi"]))
        clearances = [signed(shape, d[:2]) - d[4] for d in busy.discs[k]]
        clearances += [shape.distance(wall) for wall in walls]
        assert row["clearance"] == pytest.approx(min(clearances), abs=1e-9)


def test_in_an_empty_world_there_is_nothing_to_be_near_to():
    trace = run(lab_run(obstacles=world(([], np.empty((0, 4)))), names=(), duration=1.0))
    assert (trace.rows["clearance"] == np.inf).all()
    assert (trace.rows["h"] == np.inf).all()
    assert trace.h.shape == (101, 0)


@pytest.mark.parametrize("d", [1, 2, 13])
def test_a_delay_holds_every_command_back_by_exactly_that_many_steps(d):
    rows = run(lab_run(delay=d * 0.01, duration=6.0)).rows
    for asked, done in (("safe_v", "applied_v"), ("safe_omega", "applied_omega")):
        assert (rows[done][:d] == 0.0).all()
        assert (rows[done][d:] == rows[asked][:-d]).all()


def test_without_delay_and_limits_the_wheels_do_what_is_asked():
    rows = run(lab_run()).rows
    assert (rows["applied_v"] == rows["safe_v"]).all()
    assert (rows["applied_omega"] == rows["safe_omega"]).all()
    assert not rows["saturated"].any()


def changes(rows):
    """Largest change of a wheel's rim speed from step to step [m/s]."""
    dv, domega = (np.diff(rows[c], prepend=0.0) for c in ("applied_v", "applied_omega"))
    return np.abs(dv) + 0.25 * np.abs(domega)


@pytest.mark.parametrize("k_cbf", [0.25, 1.5])
@pytest.mark.parametrize("person", [False, True])
def test_with_limits_on_no_command_jumps_more_than_the_wheels_can(k_cbf, person):
    """Switching between person, controller and barrier included; E5 asks for metres per second."""
    rows = run(lab_run(k_cbf, limits=SALLY, operator=OperatorModel(active=person))).rows
    assert changes(rows).max() <= 2.0 * 0.01 * (1 + 1e-12)
    rim = np.abs(rows["applied_v"]) + 0.25 * np.abs(rows["applied_omega"])
    assert rim.max() <= 1.2 * (1 + 1e-15)
    assert np.abs(rows["applied_v"]).max() <= 1.0
    assert np.abs(rows["applied_omega"]).max() <= 2.0


def test_saturation_is_reported_exactly_where_the_wheels_did_something_else():
    rows = run(lab_run(0.25, limits=SALLY)).rows
    other = (rows["applied_v"] != rows["safe_v"]) | (rows["applied_omega"] != rows["safe_omega"])
    assert other.any()
    assert not other.all()
    assert (rows["saturated"] == other).all()


@given(st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=1, max_size=20))
@settings(max_examples=25)
def test_the_recorded_energy_is_the_springs_and_never_negative(path):
    """(40)–(42): from a centred stick the passivity integral is V_h of the raw deflection."""
    times = 0.3 + 0.02 * np.arange(len(path))
    hand = (times, np.array([p[0] for p in path]), np.array([p[1] for p in path]))
    rows = run(lab_run(recorded_stick=replay(*hand), duration=1.0)).rows
    spring = 0.5 * Gains().k_s * (rows["stick_x"] ** 2 + rows["stick_psi"] ** 2)
    assert rows["energy"] == pytest.approx(spring, abs=1e-12)
    assert rows["energy"].min() >= -1e-12


def test_fast_turns_in_free_space_are_blamed_on_the_heading_and_no_obstacle():
    """E6, seen from outside: the filter acts although nothing is near."""
    # Starting across the path asks for a turn at once; the only disc is 50 m away.
    setup = lab_run(
        start=Pose(0.0, -1.75, -0.8), duration=2.0, gains=Gains(k_psi=4.0),
        obstacles=world(([Body(disc(50.0, 50.0, 0.1))], np.empty((0, 4)))), names=("far",),
    )  # fmt: skip
    rows = run(setup).rows
    acting = rows[rows["verdict"] != 0]
    assert len(acting) > 3
    assert (acting["limiting"] == -1).all()


def test_a_number_that_is_not_finite_stops_the_robot_with_the_reason():
    hand = (np.array([1.0, 1.5]), np.array([math.nan, 0.0]), np.zeros(2))
    rows = run(lab_run(recorded_stick=replay(*hand), duration=3.0, limits=SALLY)).rows
    lost = (rows["t"] > 0.995) & (rows["t"] < 1.495)
    assert (rows["verdict"][lost] == 3).all()
    assert (rows["safe_v"][lost] == 0.0).all()
    assert np.isfinite(rows["applied_v"]).all()
    assert rows["applied_v"][lost][-1] == 0.0
    assert np.isfinite(rows["x"]).all()


def test_the_reference_of_another_speed_takes_its_own_time():
    slow = lab_run(None, reference=through([(0, -1.75), (0, 3.0)], 0.25))
    assert run(slow).rows["t"][-1] == pytest.approx(4.75 / 0.25)
