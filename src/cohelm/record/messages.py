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
from rosbags.typesys.store import Typestore

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
            try:
                for record in StreamReader(file, validate_crcs=True).records:
                    if isinstance(record, DataEnd):
                        return
                    yield record
            except struct.error:  # also within a record's head, which mcap takes for damage
                if file.read(1):
                    raise
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
    decoder = Decoder(path, topics.__contains__)
    for record in records(path, damaged):
        if (found := decoder.take(record)) is not None:
            yield found[0], record.log_time, found[1]


def attachment(path: Path, name: str) -> bytes | None:
    """An attachment of an MCAP file, None where it has none of that name."""
    found = (r.data for r in records(path) if isinstance(r, Attachment) and r.name == name)
    return next(found, None)


class Decoder:
    """Decodes the messages on some topics, by the definitions in their file."""

    def __init__(self, path: Path, wanted: Callable[[str], bool]) -> None:
        """wanted: says so of a topic."""
        self._path, self._wanted = path, wanted
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, tuple[str, str, Typestore]] = {}
        """Topic, type and its definition."""

    def take(self, record: Any) -> tuple[str, Any] | None:
        """Topic and content of a message on a wanted topic; None for any other record. To be called
        with all, in order. CohelmError for a definition or message that can not be read."""
        match record:
            case Schema():
                self._schemas[record.id] = record
            case Channel() if self._wanted(record.topic):
                if (schema := self._schemas.get(record.schema_id)) is None:
                    raise CohelmError(f"{self._path}: {record.topic} in it has no definition")
                self._channels[record.id] = record.topic, schema.name, self._defined(schema)
            case Message() if record.channel_id in self._channels:
                topic, name, store = self._channels[record.channel_id]
                try:
                    return topic, store.deserialize_cdr(record.data, name)
                except SerdeError as error:
                    why = f"{self._path}: a {name} can not be read ({error})"
                    raise CohelmError(why) from error
            case _:
                pass
        return None

    def _defined(self, schema: Schema) -> Typestore:
        store = get_typestore(Stores.EMPTY)
        try:
            store.register(get_types_from_msg(schema.data.decode(), schema.name))
        except (TypesysError, UnicodeDecodeError) as error:
            raise CohelmError(
                f"{self._path}: the definition of {schema.name} in it can not be read ({error}): "
                "record it again"
            ) from error
        return store
