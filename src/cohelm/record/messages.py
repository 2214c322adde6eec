"""Reads any MCAP file, as far as it is whole, and its ROS 2 messages by their definitions."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import zstandard
from mcap.exceptions import EndOfFile, InvalidMagic, McapError
from mcap.records import Attachment, Channel, DataEnd, Message, Schema
from mcap.stream_reader import StreamReader
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from cohelm.core.errors import CohelmError
from cohelm.core.files import check_regular

_DAMAGED = (
    McapError, struct.error, ValueError, OverflowError, MemoryError, zstandard.ZstdError
)  # fmt: skip
"""What mcap raises on bytes that are cut off or changed (a changed length may be immense)."""


def records(path: Path, damaged: Callable[[str], None] = lambda _: None) -> Iterator[Any]:
    """All records of the file up to its end, or up to the damage, which is passed to `damaged`.

    Raises CohelmError where there is no such file, or it is no MCAP.
    """
    check_regular(path)
    try:
        with path.open("rb") as file:
            for record in StreamReader(file, validate_crcs=True).records:
                if isinstance(record, DataEnd):
                    return
                yield record
            damaged("it ends too early")
    except InvalidMagic as error:
        raise CohelmError(f"{path} is not an MCAP file: give a record of cohelm") from error
    except EndOfFile:
        damaged("it ends too early")
    except _DAMAGED as error:
        damaged(f"damaged: {error}")
    except OSError as error:
        raise CohelmError(f"{path} can not be read ({error.strerror}): check the name") from error


def messages(
    path: Path, topics: Sequence[str], damaged: Callable[[str], None] = lambda _: None
) -> Iterator[tuple[str, int, Any]]:
    """Topic, stamp [ns] and message of all messages on `topics`, in the file's order.

    A file that was cut short, or is damaged, is read up to there. Raises CohelmError as `records`
    does, and for a definition that can not be read.
    """
    decoders: dict[int, Callable[[bytes], Any]] = {}
    names: dict[int, str] = {}
    schemas: dict[int, Schema] = {}
    for record in records(path, damaged):
        match record:
            case Schema():
                schemas[record.id] = record
            case Channel() if record.topic in topics:
                names[record.id] = record.topic
                decoders[record.id] = decoder(schemas[record.schema_id], path)
            case Message() if record.channel_id in names:
                decode = decoders[record.channel_id]
                yield names[record.channel_id], record.log_time, decode(record.data)
            case _:
                pass


def attachment(path: Path, name: str) -> bytes | None:
    """An attachment of an MCAP file, None where it has none of that name."""
    found = (r.data for r in records(path) if isinstance(r, Attachment) and r.name == name)
    return next(found, None)


def decoder(schema: Schema, path: Path) -> Callable[[bytes], Any]:
    """Decoder of messages, by a definition in the file. CohelmError if that can not be read."""
    store = get_typestore(Stores.EMPTY)
    try:
        store.register(get_types_from_msg(schema.data.decode(), schema.name))
    except (TypesysError, UnicodeDecodeError) as error:
        problem = f"{path}: the definition of {schema.name} in it can not be read ({error})"
        raise CohelmError(f"{problem}: record it again") from error

    def decode(data: bytes) -> object:
        try:
            return store.deserialize_cdr(data, schema.name)
        except SerdeError as error:
            raise CohelmError(f"{path}: a {schema.name} can not be read ({error})") from error

    return decode
