"""Fields of binary messages: how a value becomes bytes and, strictly, comes back.

Little-endian, no padding, no names on the wire: a message is its fields one after the other.
Reading accepts exactly what writing makes. Anything else is `Malformed`, and nothing else is
ever raised, whatever the bytes are.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from enum import IntEnum
from typing import (
    Annotated,
    Any,
    Generic,
    NamedTuple,
    TypeVar,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")
E = TypeVar("E", bound=IntEnum)
_MORE = "…".encode()


class Malformed(Exception):
    """These bytes are no message of this protocol; the text gives the reason."""


class Reader:
    """Bytes, and the position up to which they are read."""

    __slots__ = ("at", "data")

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.at = 0

    def take(self, count: int) -> bytes:
        """The next `count` bytes."""
        end = self.at + count
        if end > len(self.data):
            raise Malformed(f"ends after {len(self.data)} bytes, {end} are needed")
        taken = self.data[self.at : end]
        self.at = end
        return taken

    def done(self) -> None:
        """Raise Malformed unless all bytes have been read."""
        if self.at != len(self.data):
            raise Malformed(f"{len(self.data) - self.at} bytes too many")


class WireField(NamedTuple, Generic[T]):
    """One part of a message."""

    write: Callable[[bytearray, T], None]
    """Appends the value; ValueError for a value that can not be encoded."""
    read: Callable[[Reader], T]
    """Takes the value, or raises Malformed."""
    most: int
    """Largest number of bytes it takes."""


def whole(form: str) -> WireField[int]:
    """An unsigned integer: `B`, `H`, `I` or `Q` of struct."""
    layout = struct.Struct("<" + form)
    largest = 256**layout.size - 1

    def write(into: bytearray, value: int) -> None:
        if not 0 <= value <= largest:
            raise ValueError(f"{value} is not in 0..{largest}")
        into += layout.pack(value)

    def read(reader: Reader) -> int:
        return layout.unpack(reader.take(layout.size))[0]

    return WireField(write, read, layout.size)


def reported(form: str) -> WireField[float]:
    """Any number; NaN means unknown, infinity none."""
    layout = struct.Struct("<" + form)

    def write(into: bytearray, value: float) -> None:
        try:
            into += layout.pack(value)
        except OverflowError:
            into += layout.pack(math.copysign(math.inf, value))

    def read(reader: Reader) -> float:
        return layout.unpack(reader.take(layout.size))[0]

    return WireField(write, read, layout.size)


def _write_flag(into: bytearray, value: bool) -> None:
    into.append(1 if value else 0)


def _read_flag(reader: Reader) -> bool:
    byte = reader.take(1)[0]
    if byte > 1:
        raise Malformed(f"{byte} is neither yes nor no")
    return byte == 1


FLAG: WireField[bool] = WireField(_write_flag, _read_flag, 1)


def choice(of: type[E]) -> WireField[E]:
    """One of an enumeration, as a byte."""

    def read(reader: Reader) -> E:
        byte = reader.take(1)[0]
        try:
            return of(byte)
        except ValueError:
            raise Malformed(f"{byte} is no {of.__name__}") from None

    def write(into: bytearray, value: E) -> None:
        into.append(of(value))

    return WireField(write, read, 1)


def text(most: int) -> WireField[str]:
    """UTF-8 of at most `most` bytes, without control characters; a longer text ends with "…", after
    a whole word."""
    count = _count("B" if most < 256 else "H", most, "bytes of text")

    def write(into: bytearray, value: str) -> None:
        clean = "".join(c if c.isprintable() else " " for c in value)
        cut = clean.encode("utf-8", "replace")
        if len(cut) > most:  # the reader must see that there was more
            cut = _beginning(cut, most - len(_MORE)) + _MORE
        count.write(into, len(cut))
        into += cut

    def read(reader: Reader) -> str:
        try:
            value = reader.take(count.read(reader)).decode("utf-8")
        except UnicodeDecodeError:
            raise Malformed("a text that is not UTF-8") from None
        if not value.isprintable():
            raise Malformed("a text with control characters")
        return value

    return WireField(write, read, count.most + most)


def _beginning(value: bytes, most: int) -> bytes:
    """At most so many bytes of UTF-8, up to a word's end or, within a very long one, a letter's."""
    words, _, _ = value[: most + 1].rpartition(b" ")
    whole = value[:most].decode("utf-8", "ignore").encode()
    return words if 2 * len(words) > most else whole


def many(item: WireField[T], most: int) -> WireField[tuple[T, ...]]:
    """Up to `most` items; of more, the first."""
    count = _count("B" if most < 256 else "H", most, "items")

    def write(into: bytearray, values: tuple[T, ...]) -> None:
        count.write(into, min(len(values), most))
        for value in values[:most]:
            item.write(into, value)

    def read(reader: Reader) -> tuple[T, ...]:
        return tuple(item.read(reader) for _ in range(count.read(reader)))

    return WireField(write, read, count.most + most * item.most)


def array(dtype: str, columns: int, most: int) -> WireField[NDArray[Any]]:
    """Up to `most` rows of numbers, shape (n, columns), or (n,) for 0 columns; of more, the first.

    Reading takes any numbers; a message restricts them by `checked`.
    """
    kind = np.dtype(dtype).newbyteorder("<")
    wide = max(columns, 1)
    count = _count("I", most, "rows")

    def write(into: bytearray, values: NDArray[Any]) -> None:
        rows = np.ascontiguousarray(values[:most], dtype=kind)
        if rows.shape[1:] != ((columns,) if columns else ()):
            raise ValueError(f"an array of shape {rows.shape} where rows of {columns} belong")
        count.write(into, len(rows))
        into += rows.tobytes()

    def read(reader: Reader) -> NDArray[Any]:
        length = count.read(reader)
        raw = reader.take(length * wide * kind.itemsize)
        rows = np.frombuffer(raw, kind).reshape((length, columns) if columns else (length,))
        return rows.astype(kind.newbyteorder("="))

    return WireField(write, read, count.most + most * wide * kind.itemsize)


def blob(most: int) -> WireField[bytes]:
    """Up to `most` bytes as they are."""
    count = _count("I", most, "bytes")

    def write(into: bytearray, value: bytes) -> None:
        count.write(into, len(value))
        into += value

    def read(reader: Reader) -> bytes:
        return reader.take(count.read(reader))

    return WireField(write, read, count.most + most)


def record(of: Callable[..., T], *fields: WireField[Any]) -> WireField[T]:
    """A NamedTuple, its fields in order."""

    def write(into: bytearray, value: Any) -> None:
        for field, part in zip(fields, value, strict=True):
            field.write(into, part)

    def read(reader: Reader) -> T:
        return of(*[field.read(reader) for field in fields])

    return WireField(write, read, sum(field.most for field in fields))


def checked(field: WireField[T], wrong: Callable[[T], str]) -> WireField[T]:
    """The same field, with a condition: `wrong` returns what is wrong, or an empty string."""

    def write(into: bytearray, value: T) -> None:
        if problem := wrong(value):
            raise ValueError(problem)
        field.write(into, value)

    def read(reader: Reader) -> T:
        value = field.read(reader)
        if problem := wrong(value):
            raise Malformed(problem)
        return value

    return WireField(write, read, field.most)


def real(form: str, least: float = -math.inf, most: float = math.inf) -> WireField[float]:
    """A finite number, `f` or `d` of struct, in [least, most]."""

    def wrong(value: float) -> str:
        fits = math.isfinite(value) and least <= value <= most
        return "" if fits else f"{value} is not a number in [{least}, {most}]"

    return checked(reported(form), wrong)


def _count(form: str, most: int, what: str) -> WireField[int]:
    """The number of things that follow, of which at most `most` are allowed."""
    return checked(
        whole(form), lambda n: f"{n} {what} where {most} are allowed" if n > most else ""
    )


class UpTo(NamedTuple):
    """Annotation of a tuple: its largest number of items."""

    most: int


def _tuple(*parts: Any) -> Any:
    return parts


_REPORTED = reported("f")


def layout(of: Any) -> WireField[Any]:
    """The binary layout of a type, from its annotations.

    `Annotated[...]` gives a `WireField`, or for a tuple `UpTo`. Without: a float is an `f` that may
    be any number, a bool a flag, an enumeration a byte, a NamedTuple its fields in order.
    """
    if get_origin(of) is Annotated:
        plain, about = get_args(of)
        if isinstance(about, UpTo):
            return many(layout(get_args(plain)[0]), about.most)
        field: WireField[Any] = about
        return field
    if get_origin(of) is tuple:
        return record(_tuple, *map(layout, get_args(of)))
    if of is float:
        return _REPORTED
    if of is bool:
        return FLAG
    if issubclass(of, IntEnum):
        return choice(of)
    hints = get_type_hints(of, include_extras=True)
    if not hints:
        raise TypeError(f"{of.__name__} says nothing of its bytes")
    return record(of, *map(layout, hints.values()))
