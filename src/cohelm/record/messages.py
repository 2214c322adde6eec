"""ROS 2 messages of any MCAP file, decoded by the definitions that travel in it."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import zstandard
from mcap.exceptions import EndOfFile, InvalidMagic, McapError
from mcap.records import Attachment, Channel, DataEnd, Message, Schema
from mcap.stream_reader import StreamReader
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from cohelm.core.errors import CohelmError
from cohelm.core.files import check_regular

_DAMAGED = (
    McapError, struct.error, ValueError, OverflowError, MemoryError, zstandard.ZstdError
)  # fmt: skip


def messages(
    path: Path, topics: Sequence[str], damaged: Callable[[], None] = lambda: None
) -> Iterator[tuple[str, int, Any]]:
    """Topic, stamp [ns] and message of all messages on `topics`, in the file's order.

    A file that was cut short, or is damaged, is read up to there, and `damaged` is called. Raises
    CohelmError where there is no such file, it is no MCAP, or a definition in it can not be read.
    """
    decoders: dict[int, Callable[[bytes], Any]] = {}
    names: dict[int, str] = {}
    schemas: dict[int, Schema] = {}
    check_regular(path)
    try:
        with path.open("rb") as file:
            for record in _records(file):
                match record:
                    case Schema():
                        schemas[record.id] = record
                    case Channel() if record.topic in topics:
                        names[record.id] = record.topic
                        decoders[record.id] = _decoder(schemas[record.schema_id], path)
                    case Message() if record.channel_id in names:
                        decode = decoders[record.channel_id]
                        yield names[record.channel_id], record.log_time, decode(record.data)
                    case DataEnd():
                        return
                    case _:
                        pass
        damaged()
    except InvalidMagic as error:
        raise CohelmError(f"{path} is not an MCAP file: give a record in that format") from error
    except OSError as error:
        raise CohelmError(f"{path} can not be read ({error.strerror}): check the name") from error


def attachment(path: Path, name: str) -> bytes | None:
    """An attachment of an MCAP file, None where it has none of that name."""
    check_regular(path)
    try:
        with path.open("rb") as file:
            for record in _records(file):
                if isinstance(record, Attachment) and record.name == name:
                    return record.data
    except InvalidMagic as error:
        raise CohelmError(f"{path} is not an MCAP file: give a record in that format") from error
    except OSError as error:
        raise CohelmError(f"{path} can not be read ({error.strerror}): check the name") from error
    return None


def _records(file: Any) -> Iterator[Any]:
    """All records, up to the end or to where the file is damaged."""
    reader = StreamReader(file).records
    while True:
        try:
            record = next(reader, None)
        except InvalidMagic:
            raise
        except (EndOfFile, *_DAMAGED):
            return
        if record is None:
            return
        yield record


def _decoder(schema: Schema, path: Path) -> Callable[[bytes], Any]:
    store = get_typestore(Stores.EMPTY)
    try:
        store.register(get_types_from_msg(schema.data.decode(), schema.name))
    except (TypesysError, UnicodeDecodeError) as error:
        said = f"{path}: the definition of {schema.name} in it can not be read ({error})"
        raise CohelmError(f"{said}: record it again") from error
    return lambda data: store.deserialize_cdr(data, schema.name)
