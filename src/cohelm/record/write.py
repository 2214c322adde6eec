"""Writes the record of a simulated run while it goes on."""

from __future__ import annotations

import math
import signal
import threading
import zlib
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType, TracebackType

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.interrupts import INTERRUPTS
from cohelm.core.trace import Trace
from cohelm.core.types import Floats, Pose, Twist
from cohelm.link.bulk_messages import LineKind, Map, Polyline, ZoneMap
from cohelm.link.messages import Discs
from cohelm.link.recorded_status import Displayed
from cohelm.record.file import About, RecordWriter
from cohelm.record.topics import NO_WALLS
from cohelm.robot.port import Odometry

EPOCH = 946_684_800_000_000_000
"""2000-01-01T00:00:00Z [ns]: time stamp of t = 0 of a simulated run.
Not 0, which ROS 2 takes for "no time" and viewers for "the newest"."""

RATE = 50.0
"""Rate of all topics but obstacles [Hz]; `/period` comes every control step."""

OBSTACLE_RATE = 10.0
"""Rate of `/obstacles`, while one moves [Hz]."""


@dataclass(frozen=True)
class RunScene:
    """What is constant during a run and is drawn once.

    outline: (k, 2) corners of the robot, body frame [m]. walls: (s, 4), segments x1, y1, x2, y2
    in the map [m]. lines: the reference, its waypoints.
    """

    outline: Floats = field(default_factory=lambda: np.empty((0, 2)))
    walls: Floats = field(default_factory=lambda: NO_WALLS)
    lines: tuple[Polyline, ...] = ()
    zones: tuple[ZoneMap, ...] = ()


class Recorder:
    """Writes the pieces of a run as they come: `with Recorder(path, scene) as r: r.write(piece)`.

    After each `write` that piece is complete in the file and can be read back, whether Ctrl-C, a
    crash of the program or a full disk comes next. On leaving the `with` the file is finished; a
    file without a step is removed.

    Raises CohelmError if the file can not be created or grown; it never changes an existing file.
    """

    def __init__(self, path: Path, scene: RunScene | None = None) -> None:
        """Create the file at `path`."""
        self.path = path
        self._scene = RunScene() if scene is None else scene
        self._steps = 0
        self._broken = False
        self._record: RecordWriter | None = None
        try:
            self._file = path.open("xb")
        except OSError as error:
            raise CohelmError(_cannot_create(path, error)) from error

    def __enter__(self) -> Recorder:
        return self

    def write(self, piece: Trace) -> None:
        """Append the steps of a trace; all pieces of a file are of one run, in order."""
        if not len(piece):
            return
        with _delaying_interrupts(), self._growing():
            record = self._record or self._begin(piece)
            every, discs_every = _every(RATE, piece.dt), _every(OBSTACLE_RATE, piece.dt)
            for j, row in enumerate(piece.rows):
                k, discs = self._steps + j, piece.discs[j]
                all_topics = k % every == 0
                if all_topics:
                    record.write(_odometry(row))
                record.period(row, piece.h[j], discs, all_topics)
                if k % discs_every == 0 and _moved(piece.discs, j, discs_every):
                    with np.errstate(over="ignore"):  # beyond single precision
                        shown = Discs(k, discs.astype(np.float32))
                    record.write(Displayed(float(row["t"]), shown))
            record.flush()
            self._steps += len(piece)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Finish the file, also after Ctrl-C or an error elsewhere, which is noted in it."""
        with _delaying_interrupts():
            try:
                if self._steps and self._record is not None and not self._broken:
                    with self._growing():
                        if kind is not None:
                            self._record.stopped(kind.__name__)
                        self._record.finish()
            finally:
                # The raw file: on a full disk, closing the buffered one would write again.
                self._file.raw.close()
                if not self._steps:
                    self.path.unlink(missing_ok=True)

    def _begin(self, piece: Trace) -> RecordWriter:
        about = About("run", EPOCH, piece.scenario, piece.names, piece.dt)
        scene, t = self._scene, float(piece.rows["t"][0])
        self._record = RecordWriter(self._file, about, outline=scene.outline, walls=scene.walls)
        route = [line.points for line in scene.lines if line.what is LineKind.REFERENCE]
        also = np.vstack([np.empty((0, 2)), *route]).astype(np.float64)
        for what in (drawn(scene.walls, also), *scene.zones, *scene.lines):
            self._record.write(Displayed(t, what))
        return self._record

    @contextmanager
    def _growing(self) -> Generator[None]:
        """A failed write ends the recording; the error says what is left of it."""
        try:
            yield
        except OSError as error:
            self._broken = True
            left = "what came before can be read" if self._steps else "nothing is left of it"
            raise CohelmError(
                f"{self.path}: recording stopped ({error.strerror}) and {left}: "
                "free some space, or record in another folder"
            ) from error


def _every(rate: float, dt: float) -> int:
    return max(1, round(1.0 / (rate * dt)))


def _moved(discs: Floats, j: int, since: int) -> bool:
    """Whether to draw the discs of step j: where they moved, and once at a piece's start."""
    return j < since or not np.array_equal(discs[j], discs[j - since])


def _odometry(row: np.void) -> Odometry:
    """Exact odometry of a run: its pose, and the command that reached its wheels."""
    pose = Pose(float(row["x"]), float(row["y"]), float(row["psi"]))
    return Odometry(
        float(row["t"]), pose, Twist(float(row["applied_v"]), float(row["applied_omega"]))
    )


def _cannot_create(path: Path, error: OSError) -> str:
    """Why the file can not be created, and what to do."""
    match error:
        case FileExistsError():
            return f"{path} exists and is never overwritten: move it away or choose another name"
        case FileNotFoundError():
            return f"{path}: the folder {path.parent} does not exist: make it or choose another"
        case _:
            return f"{path} can not be made ({error.strerror}): choose a folder you may write to"


@contextmanager
def _delaying_interrupts() -> Generator[None]:
    """Delay Ctrl-C until the block is done, so that it never leaves half a chunk: `INTERRUPTS`,
    and SIGALRM, by which `cli/app` repeats one that was put off.

    Each may arrive, and raise, while the handler of another is being exchanged. So `later`
    checks `over`: left in place, it restores the former handler and raises the signal again.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # Ctrl-C reaches the main thread only
        return
    held, over = list[int](), False
    kinds = (*INTERRUPTS, signal.SIGALRM)
    before = {kind: signal.getsignal(kind) for kind in kinds}

    def later(number: int, _: FrameType | None) -> None:
        if not over:
            held.append(number)
            return
        signal.signal(number, before[signal.Signals(number)])
        signal.raise_signal(number)

    try:
        for kind in before:
            signal.signal(kind, later)
        yield
    finally:
        over = True
        for kind, handler in before.items():
            signal.signal(kind, handler)
        if held:
            signal.raise_signal(held[0])


CELL = 0.05
MARGIN = 1.0
_MOST_CELLS = 2000


def drawn(walls: Floats, also: Floats) -> Map:
    """Walls drawn into an occupancy map, for the page. walls: (s, 4) segments [m]. also: (n, 2)
    further points for the map to include [m]."""
    points = np.vstack((walls[:, :2], walls[:, 2:], also, np.zeros((0 if len(also) else 1, 2))))
    low, high = points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN
    cell = max(CELL, float((high - low).max()) / _MOST_CELLS)
    width, height = np.ceil((high - low) / cell).astype(int).tolist()
    cells = np.zeros((height, width), dtype=np.uint8)
    for x1, y1, x2, y2 in walls:
        n = int(math.hypot(x2 - x1, y2 - y1) / (0.5 * cell)) + 2
        at = ((np.linspace((x1, y1), (x2, y2), n) - low) / cell).astype(int)
        cells[at[:, 1], at[:, 0]] = 100
    origin = Pose(float(low[0]), float(low[1]), 0.0)
    packed = zlib.compress(cells.tobytes())
    return Map(1, origin, cell, width, height, 0, 0, width, height, packed)
