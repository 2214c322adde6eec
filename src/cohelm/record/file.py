"""Writes one MCAP file of ROS 2 messages (`topics`) during a run or a drive."""

from __future__ import annotations

import io
import json
import math
from typing import IO, NamedTuple

from mcap.well_known import MessageEncoding, Profile, SchemaEncoding
from mcap.writer import CompressionType, Writer

from cohelm import __version__
from cohelm.core.types import Floats
from cohelm.record import period
from cohelm.record.topics import NO_WALLS, RecordTopics, definitions
from cohelm.robot.model import RobotModel

METADATA, SCENARIO, ROBOT = "cohelm", "scenario.yaml", "robot.json"
"""Names in the file: of the metadata about it, and of its attachments."""
RECORD = "record.mcap"
"""What a run's record is called in its folder."""
STOPPED = "cohelm stopped"
"""Name of the metadata of one that was stopped before its end."""


class About(NamedTuple):
    """Metadata of a record."""

    kind: str
    """run: a simulated one, by its compiled stepper. drive: of a robot, by its loop."""
    epoch: int
    """Time stamp of t = 0 [ns]."""
    scenario: str = ""
    """YAML; empty if there was none."""
    names: tuple[str, ...] = ()
    """Of a run's obstacles."""
    dt: float = math.nan
    """Of a run [s]."""


class RecordWriter:
    """Writes a record into an open file. OSError where the file can not grow."""

    def __init__(
        self, file: IO[bytes], about: About, robot: RobotModel | None = None,
        outline: Floats | None = None, walls: Floats = NO_WALLS,
    ) -> None:  # fmt: skip
        """robot: whose drive it is. outline: (k, 2) of a run's robot, body frame; walls: (s, 4)."""
        # the MCAP writer would buffer a bare file itself, where no flush of ours reaches
        self._file = io.BufferedWriter(file) if isinstance(file, io.RawIOBase) else file
        self._epoch, self._count = about.epoch, 0
        # a run is flushed piece by piece, each whole; a drive may be cut off anywhere
        chunk = 1 << (16 if about.kind == "drive" else 20)
        self._mcap = Writer(
            self._file, chunk, compression=CompressionType.ZSTD, enable_data_crcs=True
        )
        self._mcap.start(profile=Profile.ROS2, library=f"cohelm {__version__}")
        self._mcap.add_metadata(METADATA, _described(about, robot))
        if robot is not None:
            self._attach(ROBOT, "application/json", robot.model_dump_json())
        if about.scenario or robot is None:
            self._attach(SCENARIO, "application/yaml", about.scenario)
        self._channels: dict[str, int] = {}
        for topic, (name, text) in definitions(robot).items():
            schema = self._mcap.register_schema(name, SchemaEncoding.ROS2, text.encode())
            channel = self._mcap.register_channel(topic, MessageEncoding.CDR, schema)
            self._channels[topic] = channel
        topics = RecordTopics(about.epoch, self._put, robot)
        topics.begin(outline, walls)
        self.write, self.period = topics.write, topics.period

    def stopped(self, by: str) -> None:
        """The run was stopped before its end."""
        self._mcap.add_metadata(STOPPED, {"by": by})

    def flush(self) -> None:
        """Write everything so far to the file."""
        self._mcap.flush()
        self._file.flush()

    def finish(self) -> None:
        """Complete the file."""
        self._mcap.finish()
        self._file.flush()

    def _attach(self, name: str, kind: str, text: str) -> None:
        self._mcap.add_attachment(self._epoch, self._epoch, name, kind, text.encode())

    def _put(self, topic: str, data: bytes, stamp: int, number: int | None) -> None:
        self._count += 1
        count = self._count if number is None else number
        self._mcap.add_message(self._channels[topic], stamp, data, stamp, sequence=count)


def _described(about: About, robot: RobotModel | None) -> dict[str, str]:
    """What stands at the file's start: how to read it, and where it came from."""
    return {
        "kind": about.kind,
        "version": __version__,
        "period_version": str(period.VERSION),
        "robot": robot.name if robot is not None else "",
        "dt": repr(about.dt),
        "obstacles": json.dumps(about.names),
        "epoch_ns": str(about.epoch),
    }
