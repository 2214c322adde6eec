"""Hypothesis strategies for every message of the protocol."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from cohelm.core.types import Pose, Stick, Twist
from cohelm.link import bulk_messages as b, messages as m
from cohelm.link.messages import MOST_BEAMS
from cohelm.link.wire import Header

single = st.floats(width=32)
finite = st.floats(-(2.0**60), 2.0**60, width=32)
byte = st.integers(0, 2**8 - 1)
short = st.integers(0, 2**16 - 1)
long = st.integers(0, 2**32 - 1)
huge = st.integers(0, 2**64 - 1)
clock = st.floats(allow_nan=False, allow_infinity=False)
deflection = st.floats(-1.0, 1.0, width=32)


def texts(most: int) -> st.SearchStrategy[str]:
    letters = st.characters(codec="utf-8").filter(str.isprintable)
    return st.text(letters, max_size=most).filter(lambda t: len(t.encode()) <= most)


def rows(dtype: str, columns: int, most: int, **numbers: Any) -> st.SearchStrategy[Any]:
    def shaped(n: int) -> st.SearchStrategy[Any]:
        shape = (n, columns) if columns else (n,)
        if dtype.startswith("f"):
            kind = st.floats(width=int(dtype[1:]) * 8, **numbers)
            return hnp.arrays(np.dtype(dtype), shape, elements=kind)
        return hnp.arrays(np.dtype(dtype), shape)

    return st.integers(0, most).flatmap(shaped)


def listed(item: st.SearchStrategy[Any], most: int) -> st.SearchStrategy[Any]:
    return st.lists(item, max_size=most).map(tuple)


PLAIN: dict[Any, st.SearchStrategy[Any]] = {
    float: single, bool: st.booleans(), m.Byte: byte, m.Short: short, m.Long: long,
    m.Name: texts(32), m.Words: texts(64), m.Reason: texts(128), m.Refusal: texts(200),
}  # fmt: skip


def of(kind: Any) -> st.SearchStrategy[Any]:
    """Any value of a message's type."""
    if kind in PLAIN:
        return PLAIN[kind]
    if get_origin(kind) is Annotated:
        listing, most = get_args(kind)
        return listed(of(get_args(listing)[0]), most.most)
    if get_origin(kind) is tuple:
        return st.tuples(*map(of, get_args(kind)))
    if issubclass(kind, IntEnum):
        return st.sampled_from(kind)
    return st.builds(kind, *map(of, get_type_hints(kind, include_extras=True).values()))


headers = st.builds(Header, huge, long, clock, st.floats(), single)
poses = st.builds(Pose, single, single, single)
twists = st.builds(Twist, single, single)
points = st.tuples(single, single)
answers = of(m.Answer)
requests = st.builds(m.Request, long, st.sampled_from(m.RequestKind), short, clock)
commands = st.builds(
    m.Command, st.builds(Stick, deflection, deflection), st.booleans(), st.booleans(),
    st.sampled_from(m.Device), st.floats(0.0, 1.0, width=32),
)  # fmt: skip
uplinks = st.builds(m.Uplink, commands, listed(requests, 8))
statuses = of(m.Status)
scan_parts = st.builds(
    m.ScanPart, long, byte, clock, poses, long, long, single, single, rows("u2", 0, MOST_BEAMS)
)
discs = st.builds(m.Discs, long, rows("f4", 6, 40))
datagrams_down = st.one_of(statuses, scan_parts, discs)
waypoints = st.builds(
    b.Waypoints, long, rows("f8", 2, 50, allow_nan=False, allow_infinity=False), st.booleans()
)
bulk_up = st.one_of(
    waypoints,
    st.builds(b.Fetch, texts(255), huge, long),
)
bulk_down = st.one_of(
    st.builds(
        b.Hello, texts(64), rows("f4", 2, 64), single, single,
        st.tuples(single, single, single, single),
    ),
    st.builds(b.Polyline, st.sampled_from(b.LineKind), rows("f4", 2, 50)),
    st.builds(
        b.Map, long, poses, single, short, short, short, short, short, short,
        st.binary(max_size=99),
    ),
    st.builds(
        b.ZoneMap, st.sampled_from(b.Zone), poses, single, single, short, short,
        st.binary(max_size=99),
    ),
    st.builds(b.Docks, listed(st.builds(b.DockPlace, texts(24), poses, single), 50)),
    st.builds(b.HealthReport, single, listed(texts(400), 16)),
    st.builds(b.Alarms, listed(st.builds(b.WholeAlarm, of(m.Alarm), texts(400)), 32)),
    st.builds(b.Picture, long, clock, poses, st.binary(max_size=99)),
    st.builds(b.Records, listed(st.builds(b.RecordInfo, texts(255), huge, st.floats()), 9)),
    st.builds(b.Piece, texts(255), huge, st.binary(max_size=99)),
    st.builds(b.Checked, answers, short),
    st.builds(b.Digest, texts(255), huge, st.binary(max_size=32), texts(400)),
)  # fmt: skip


def same(a: Any, b: Any) -> bool:
    """Equal in type and value, NaN like NaN."""
    if type(a) is not type(b):
        return False
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and bool(np.array_equal(a, b, _floats(a)))
    if isinstance(a, tuple):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    return a == b or (isinstance(a, float) and math.isnan(a) and math.isnan(b))


def _floats(a: np.ndarray) -> bool:
    return a.dtype.kind == "f"
