"""Reading a recorded run back, exactly as it was."""

from __future__ import annotations

import json
import struct
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import zstandard
from mcap.exceptions import EndOfFile, InvalidMagic, McapError
from mcap.records import Attachment, Channel, DataEnd, Header, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from rosbags.serde import SerdeError
from rosbags.typesys import TypesysError

from cohelm.core.errors import CohelmError
from cohelm.core.files import check_regular
from cohelm.core.trace import Trace
from cohelm.record import status
from cohelm.record.write import METADATA, SCENARIO, STOPPED

_DAMAGED = (
    McapError, struct.error, ValueError, OverflowError, MemoryError, zstandard.ZstdError
)  # fmt: skip
"""What mcap raises on bytes that are cut off or changed (a changed length may be immense)."""


class IncompleteRecord(UserWarning):
    """The file ends in the middle of a run, or is damaged: only the steps before are there."""


@dataclass
class _Found:
    """What a walk through the file came across."""

    library: str = ""
    about: dict[str, str] | None = None
    scenario: str = ""
    definition: str = ""
    steps: list[bytes] = field(default_factory=list[bytes])
    stopped: str = ""
    damage: str = "it ends too early"
    """Empty if the run is whole."""


def read(path: Path) -> Trace:
    """The run in a file that `Recorder` wrote, equal to the last bit.

    From a file that was not finished, or is damaged, the steps up to there, with an
    `IncompleteRecord` warning.

    Raises CohelmError where there is no such file, or no run of cohelm in it.
    """
    check_regular(path)
    try:
        with path.open("rb") as file:
            found = _walk(file)
    except InvalidMagic as error:
        raise CohelmError(
            f"{path} is not an MCAP file: give one that `cohelm run` wrote"
        ) from error
    except OSError as error:
        raise CohelmError(f"{path} can not be read ({error.strerror}): check the name") from error
    trace = _trace(path, found)
    if found.damage:
        t = float(trace.rows["t"][-1])
        warnings.warn(
            f"{path} is not whole ({found.damage}); the run is read up to t = {t:.2f} s",
            IncompleteRecord,
            stacklevel=2,
        )
    return trace


def _walk(file: IO[bytes]) -> _Found:
    """All that concerns us, up to the end of the data or to where it is damaged."""
    found = _Found()
    status_channel = 0
    following = -1  # number of the step that must come next
    try:
        for record in StreamReader(file, validate_crcs=True).records:
            match record:
                case Header():
                    found.library = record.library
                case Metadata(name=name) if name == METADATA:
                    found.about = record.metadata
                case Attachment(name=name) if name == SCENARIO:
                    found.scenario = record.data.decode()
                case Schema(name=name) if name == status.TYPE:
                    found.definition = record.data.decode()
                case Channel(topic=topic) if topic == status.TOPIC:
                    status_channel = record.id
                case Message(channel_id=channel) if channel == status_channel:
                    if following not in (-1, record.sequence):
                        found.damage = f"step {following} is missing"
                        break
                    found.steps.append(record.data)
                    following = record.sequence + 1
                case Metadata(name=name) if name == STOPPED:
                    found.stopped = f"the run was stopped by {record.metadata.get('by')}"
                case DataEnd():
                    found.damage = found.stopped
                    break
                case _:
                    pass
    except InvalidMagic:
        raise
    except EndOfFile:
        pass
    except _DAMAGED as error:
        found.damage = f"damaged: {error}"
    return found


def _trace(path: Path, found: _Found) -> Trace:
    """The trace in what was found, or a word about why there is none."""
    about = found.about
    if about is None:
        by = f" (it was written by {found.library})" if found.library else ""
        raise CohelmError(f"{path} holds no run of cohelm{by}: give a file that `cohelm run` wrote")
    version = about.get("version", "?")
    if about.get("status_version") != str(status.VERSION):
        raise CohelmError(
            f"{path} was written by cohelm {version} in another form of {status.TOPIC} "
            f"({about.get('status_version')}, here {status.VERSION}): read it with that version"
        )
    if not found.steps:
        raise CohelmError(f"{path} ends before the first step of the run: run it again")
    try:
        decode = status.decoder(found.definition)
        return status.decoded(
            [decode(step) for step in found.steps],
            tuple(json.loads(about["obstacles"])),
            float(about["dt"]),
            found.scenario,
        )
    except AttributeError as error:
        raise CohelmError(
            f"{path} was written by cohelm {version}, which did not record {error.name!r} yet: "
            "read it with that version"
        ) from error
    except (KeyError, TypeError, ValueError, SerdeError, TypesysError) as error:
        raise CohelmError(
            f"{path}: its description of the run is damaged ({error}): run it again"
        ) from error
