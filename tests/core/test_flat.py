"""A nested named tuple is a row of numbers, and comes back as it went, compiled or not."""

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, strategies as st

from cohelm.core.flat import fill, made, named, names, numbers, read, write
from cohelm.core.jit import jit
from cohelm.core.row import MEANINGS, blank
from cohelm.core.types import Floats
from cohelm.pilot.step import START, Decision, PilotState, Settings
from cohelm.robot.limits import Limits


class Inner(NamedTuple):
    on: bool
    count: int


class Outer(NamedTuple):
    corners: Floats
    first: float
    inner: Inner
    last: float
    again: Inner


@jit
def through(row: Floats, corners: Floats, out: Floats) -> Outer:
    value = read(Outer, row, 1, (corners,))
    write(value, out, 2)
    write(value.inner, out, 8)
    return value


OUTER = st.builds(
    Outer, st.just(np.array([[1.0, 2.0], [3.0, 4.0]])), st.floats(allow_nan=False),
    st.builds(Inner, st.booleans(), st.integers(-(2**53), 2**53)), st.floats(allow_nan=False),
    st.builds(Inner, st.booleans(), st.integers(-(2**53), 2**53)),
)  # fmt: skip


def test_the_names_are_the_fields_in_order_and_say_where_they_stand():
    assert names(Outer) == (
        "first", "inner.on", "inner.count", "last", "again.on", "again.count",
    )  # fmt: skip


@given(OUTER)
def test_what_went_in_comes_out_of_python_and_of_compiled_code(value):
    row = numbers(value)
    assert row.dtype == np.float64
    back = made(Outer, row.tolist(), arrays=(value.corners,))
    out = np.full(10, -7.0)
    compiled = through(np.concatenate(([0.0], row)), value.corners, out)
    for one in (back, compiled):
        assert one[1:] == value[1:]
        assert (one.corners == value.corners).all()
        assert type(one.inner.on) is bool
        assert type(one.inner.count) is int
    assert out.tolist() == [-7.0, -7.0, *row.tolist(), value.inner.on, value.inner.count]


def test_the_pilots_own_are_what_they_were():
    assert made(PilotState, numbers(START).tolist()) == START
    limits = Limits(1.0, 2.0, 3.0, 4.0, track=0.5)
    settings = Settings(np.ones((4, 2)), limits, fastest=0.5)
    row = numbers(settings)
    assert row[names(Settings).index("fastest")] == 0.5
    assert made(Settings, row.tolist(), arrays=(settings.outline,)) == settings
    decided = made(Decision, list(map(float, range(len(names(Decision))))))
    assert numbers(decided).tolist() == [float(k) for k in range(len(names(Decision)))]
    assert decided.safe == (0.0, 1.0)


@jit
def filled(row, value):
    fill(row, value)


def test_a_row_with_names_takes_the_numbers_that_it_has_a_name_for():
    decided = made(Decision, list(map(float, range(len(names(Decision))))))
    known = {name: part for name, part in named(decided).items() if name in MEANINGS}
    assert (known["safe_v"], known["safe_omega"]) == decided.safe
    for into in (fill, filled):
        (row,) = blank(1)
        into(row, decided)
        assert {name: row[name] for name in known} == known
        assert all(np.isnan(row[name]) for name in ("t", "x", "stick_x"))


def test_a_row_that_is_too_short_is_an_error():
    with pytest.raises(IndexError):
        made(PilotState, [0.0])
