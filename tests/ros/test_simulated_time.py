"""A simulator's time on /clock: as good as the wall's, slower or standing still."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, strategies as st

from cohelm.core.types import Twist
from cohelm.ros.clock import FASTEST, SILENT, SimulatedClock


def told(times: list[tuple[float, float]], monkeypatch: pytest.MonkeyPatch) -> SimulatedClock:
    """One that was told simulated times at those of the wall."""
    monkeypatch.setattr("time.monotonic", lambda: 0.0)
    made = SimulatedClock()
    for wall, time in times:
        made.take(time, wall)
    return made


def test_nothing_is_known_before_the_first_message(monkeypatch):
    made = told([], monkeypatch)
    assert not made.known
    assert math.isnan(made.age(1.0))


@pytest.mark.parametrize("rate", [0.3, 1.0])
def test_ages_and_the_robots_own_clock_go_with_the_simulators(rate, monkeypatch):
    made = told([(0.1 * k, 50.0 + 0.1 * k * rate) for k in range(1, 101)], monkeypatch)
    assert made.known
    assert made.rate == pytest.approx(rate, abs=1e-3)
    monkeypatch.setattr("time.monotonic", lambda: 10.0)
    begun = made.now()
    assert made.age(50.0 + 9.9 * rate) == pytest.approx(0.1 * rate, abs=1e-3)
    monkeypatch.setattr("time.monotonic", lambda: 10.05)
    assert made.now() - begun == pytest.approx(0.05 * rate, abs=1e-3)
    assert made.age(50.0 + 10.0 * rate) == pytest.approx(0.05 * rate, abs=1e-3)


@pytest.mark.parametrize("rate", [0.5, 1.0])
@pytest.mark.parametrize("late", [(0.004, 0.016), (0.0, 0.0, 0.009, 0.021), (0.2, *(0.19, 0.18))])
def test_messages_that_a_busy_machine_delivers_unevenly_go_no_faster(rate, late, monkeypatch):
    """The mean of their rates would: 4 and 16 ms apart instead of 10 are 1.56 in the mean."""
    due = [0.01 * k for k in range(1, 1001)]
    walls, before = [], 0.0
    for k, at in enumerate(due):
        before = max(at + late[k % len(late)], before + 1e-5)
        walls.append(before)
    made = told(
        [(wall, 50.0 + at * rate) for wall, at in zip(walls, due, strict=True)], monkeypatch
    )
    assert made.rate == pytest.approx(rate, abs=0.03)


def test_messages_that_were_held_up_and_come_at_once_go_no_faster(monkeypatch):
    walls = [
        0.01 * (k if k % 50 >= 25 else 25 + 50 * (k // 50)) + 1e-5 * (k % 50) for k in range(500)
    ]
    for n in range(300, 500):
        made = told([(wall, 0.01 * k) for k, wall in enumerate(walls[:n])], monkeypatch)
        assert made.rate < FASTEST


def test_where_it_is_silent_readings_get_old_by_the_walls(monkeypatch):
    made = told([(0.1 * k, 0.1 * k) for k in range(1, 11)], monkeypatch)
    monkeypatch.setattr("time.monotonic", lambda: 1.0)
    begun = made.now()
    monkeypatch.setattr("time.monotonic", lambda: 4.0)
    assert made.now() - begun == pytest.approx(3.0, abs=0.01)
    assert made.age(1.0) == pytest.approx(SILENT, abs=0.01)  # of what comes after it goes on


def test_one_that_is_set_back_does_not_set_the_robots_own_back(monkeypatch):
    made = told([(0.1, 70.0), (0.2, 70.1)], monkeypatch)
    monkeypatch.setattr("time.monotonic", lambda: 0.2)
    begun = made.now()
    made.take(0.0, 0.3)
    monkeypatch.setattr("time.monotonic", lambda: 0.3)
    assert begun <= made.now() <= begun + 0.11
    assert made.age(0.0) == pytest.approx(0.0)


@given(st.lists(st.tuples(st.floats(0.0, 1.0), st.floats(-5.0, 5.0)), max_size=40))
def test_the_robots_own_never_goes_back_nor_runs_away(steps):
    with pytest.MonkeyPatch.context() as patched:
        wall = [0.0]
        patched.setattr("time.monotonic", lambda: wall[0])
        made, time, before = SimulatedClock(), 0.0, 0.0
        for passed, way in steps:
            wall[0] += passed
            time += way
            made.take(time, wall[0])
            now = made.now()
            assert before <= now <= before + FASTEST * passed + SILENT + 1e-9
            before = now


@pytest.mark.xdist_group("realtime")
@pytest.mark.slow
@pytest.mark.parametrize("rate", [0.5, 1.0])
def test_a_simulated_robot_is_stopped_before_a_wall_and_stands_while_its_simulator_does(rate):
    pytest.importorskip("cyclonedds", reason="cyclonedds has no wheel for this machine")
    from tests.ros.stage import stage, until

    with stage(rate=rate, stamped=True) as it:
        assert it.found.simulated
        assert any("simulated time: /clock" in note for note in it.found.notes)
        assert it.found.model.lidar.rate_hz == pytest.approx(10.0, rel=0.2)
        assert it.drives(0.5)
        it.base.fault("pause")
        assert until(lambda: any("ms old" in said for said in it.filter.said))
        assert not it.filter.latched
        it.base.fault("")
        it.filter.said.clear()
        it.controller.twist = Twist(1.0, 0.0)
        assert until(lambda: it.base.truth().pose.x > 3.3, 30.0)
        assert it.stands()
        assert not it.filter.latched
        assert it.base.truth().least_moving > 0.01
