"""Nested named tuples of numbers as rows of an array, and back, made from their fields.

A call from Python into compiled code unpacks an array in 150 ns, and each named tuple in 800. So
what goes in and comes out is one row: `numbers` and `made` in Python, `read` and `write` in
compiled code. A bool is 0 or 1, an int a whole number below 2**53; arrays are none of the numbers,
they are handed over beside the row: `flat` makes both. `named` and `fill` are for a row whose
fields have names, as `core.row`.
"""

from __future__ import annotations

import typing
from collections.abc import Callable, Sequence
from functools import cache
from operator import attrgetter
from typing import Any, TypeVar, cast

import numpy as np
from numba import types
from numba.extending import overload

from cohelm.core.types import Floats

T = TypeVar("T", bound=tuple[Any, ...])

Flat = tuple[Floats, tuple[Any, ...]]
"""The numbers of a named tuple, and its arrays, both in order."""


@cache
def names(of: type, numeric: bool = True) -> tuple[str, ...]:
    """Dotted names of the numbers of a class of named tuples, in order: `clock.tau`. numeric: or of
    all else, its arrays."""
    found: list[str] = []
    for field, kind in typing.get_type_hints(of).items():
        if _is_tuple(kind):
            found += [f"{field}.{inner}" for inner in names(kind, numeric)]
        elif (kind in (float, int, bool)) == numeric:
            found.append(field)
    return tuple(found)


def flat(value: tuple[Any, ...]) -> Flat:
    """A named tuple as compiled code takes it fast; `made` and `read` undo it."""
    return numbers(value), _getter(type(value), False)(value)


def numbers(value: tuple[Any, ...]) -> Floats:
    """The numbers of a named tuple, in the order of `names`."""
    return np.array(_getter(type(value))(value), dtype=np.float64)


def made(of: type[T], row: Sequence[float], first: int = 0, arrays: tuple[Floats, ...] = ()) -> T:
    """The named tuple of a row, from row[first] on. arrays: its fields that are arrays, in
    order."""
    return _maker(of)(of, row, first, arrays)


def read(of: type[T], row: Floats, first: int, arrays: tuple[Floats, ...] = ()) -> T:
    """As `made`, for compiled code."""
    return made(of, row.tolist(), first, arrays)


def write(value: tuple[Any, ...], row: Floats, first: int) -> None:
    """Write the numbers of a named tuple to a row from row[first] on; for compiled code too."""
    row[first : first + len(names(type(value)))] = _getter(type(value))(value)


def named(value: tuple[Any, ...]) -> dict[str, float]:
    """The numbers of a named tuple, by name as `core.row` has it: `clock_tau` for `clock.tau`."""
    return dict(zip(_columns(type(value)), _getter(type(value))(value), strict=True))


def fill(row: Any, value: tuple[Any, ...]) -> None:
    """Write the numbers of a named tuple to those fields of a row that are called as in `named`;
    for compiled code too."""
    for column, number in named(value).items():
        if column in row.dtype.names:
            row[column] = number


@overload(read, strict=False)
def _read(of: Any, row: Any, first: Any, arrays: Any = ()) -> Any:
    if not isinstance(of, types.NamedTupleClass):
        return None
    return _compilable(*_reader(cast(Any, of).instance_class, "{}({})"))


@overload(write, strict=False)
def _write(value: Any, row: Any, first: Any) -> Any:
    if not isinstance(value, types.BaseNamedTuple):
        return None
    known = names(cast(Any, value).instance_class)
    lines = [f"    row[first + {i}] = value.{name}" for i, name in enumerate(known)]
    return _compilable("\n".join(["def made(value, row, first):", *lines]), {})


@overload(fill, strict=False)
def _fill(row: Any, value: Any) -> Any:
    if not (isinstance(row, types.Record) and isinstance(value, types.BaseNamedTuple)):
        return None
    of: type = cast(Any, value).instance_class
    fields = zip(_columns(of), names(of), strict=True)
    known = cast(Any, row).fields
    lines = [f"    row.{column} = value.{name}" for column, name in fields if column in known]
    return _compilable("\n".join(["def made(row, value):", *lines]), {})


@cache
def _columns(of: type) -> tuple[str, ...]:
    return tuple(name.replace(".", "_") for name in names(of))


@cache
def _getter(of: type, numeric: bool = True) -> Callable[[Any], tuple[Any, ...]]:
    known = names(of, numeric)
    if not known:
        return lambda value: ()
    found = attrgetter(*known)
    return found if len(known) > 1 else lambda value: (found(value),)


@cache
def _maker(of: type) -> Callable[..., Any]:
    source, known = _reader(of, "new({}, ({},))")  # the class's own is twice as slow
    return _compilable(f"new = tuple.__new__\n{source}", known)


def _reader(of: type, call: str) -> tuple[str, dict[str, Any]]:
    """The source of a function that makes one, and the classes it needs. call: of a class, with its
    fields."""
    classes: dict[str, Any] = {}
    counts = [0, 0]  # numbers, arrays

    def expression(kind: type) -> str:
        name = f"_{len(classes)}"
        classes[name] = kind
        return call.format(name, ", ".join(map(part, typing.get_type_hints(kind).values())))

    def part(kind: Any) -> str:
        if _is_tuple(kind):
            return expression(kind)
        number = kind in (float, int, bool)
        at = counts[not number]
        counts[not number] += 1
        if not number:
            return f"arrays[{at}]"
        given = f"row[first + {at}]"
        return f"int({given})" if kind is int else f"{given} != 0.0" if kind is bool else given

    return f"def made(of, row, first, arrays=()):\n    return {expression(of)}", classes


def _compilable(source: str, known: dict[str, Any]) -> Callable[..., Any]:
    made: dict[str, Any] = dict(known)
    exec(source, made)
    return made["made"]


def _is_tuple(kind: Any) -> bool:
    return isinstance(kind, type) and hasattr(kind, "_fields")
