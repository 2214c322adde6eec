"""Receives the masks of Nav2's costmap filters: a filter's purpose, and the grid that it names."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose
from cohelm.ros import mismatch
from cohelm.ros.mismatch import FILTER_INFO, GRID
from cohelm.ros.names import resolved
from cohelm.ros.port import LATCHED, End, Endpoint, Received, Transport
from cohelm.ros.transforms import yaw_of

KEEP_OUT, PERCENT, SPEED = 0, 1, 2
"""Types of filters: zones to keep out of, and limits in percent of the usual speed, or in m/s."""
_OPTION = "--masks-from"
_FINEST, _COARSEST = 1e-3, 100.0
"""Cells of another size are a mistake [m]."""
_MOST = 1e6
"""No base and multiplier are more, together."""
_FLAT = 1e-3
"""A grid that is inclined by less is flat, as sin of half the angle."""


class FilterMask(NamedTuple):
    """One filter, by its two messages."""

    info: str
    """The topic of its CostmapFilterInfo."""
    topic: str
    """Of its grid."""
    kind: int
    base: float
    multiplier: float
    """base + multiplier * value is the limit; of zones to keep out of neither counts."""
    cells: NDArray[np.int8]
    """(rows, columns), row 0 at the smallest y of its own axes; -1: unknown."""
    resolution: float
    """[m]"""
    origin: Pose
    """Of the outer corner of cell (0, 0), in the map."""

    @property
    def name(self) -> str:
        """For messages to the user."""
        return f"{self.topic} (named by {self.info})"


class Masks:
    """What filters have published since this was made, the newest of each."""

    def __init__(
        self, transport: Transport, topics: Sequence[str], frame: str, namespace: str = "/",
        on_change: Callable[[], None] = lambda: None,
    ) -> None:  # fmt: skip
        """topics: of CostmapFilterInfo. frame: the map's, in which the grids have to be. on_change:
        called after each message, from any thread. CohelmError for an invalid topic name."""
        self._transport, self._frame, self._space = transport, frame, namespace
        self._on_change = on_change
        self.topics = tuple(dict.fromkeys(resolved(name, namespace) for name in topics))
        self._received: dict[str, Received] = {}
        self._ends: dict[str, End] = {}
        for topic in self.topics:
            self._listen(topic, FILTER_INFO)

    def read(self, wait: float) -> tuple[FilterMask, ...]:
        """All of them, as soon as they are there, after `wait` [s] at most. CohelmError with what
        is missing or can not be used, one sentence a line."""
        end = time.monotonic() + wait
        while not all(self._complete(topic) for topic in self.topics) and time.monotonic() < end:
            time.sleep(0.05)
        made, errors = list[FilterMask](), list[str]()
        for topic in self.topics:
            try:
                made.append(self._mask(topic))
            except CohelmError as error:
                errors.append(str(error))
        for kinds, said in (((KEEP_OUT,), "keep-out zones"), ((PERCENT, SPEED), "speed zones")):
            same = [one.info for one in made if one.kind in kinds]
            if len(same) > 1:
                errors.append(f"{' and '.join(same)} both define {said}: name one with {_OPTION}")
        if errors:
            raise CohelmError("\n".join(errors))
        return tuple(made)

    def changed(self, used: Sequence[FilterMask]) -> tuple[FilterMask, ...]:
        """Those in use, each as its filter publishes it now, and the same object where that is
        unchanged. CohelmError for what can not be used instead; not to be called by `on_change`."""
        made: list[FilterMask] = []
        for one in used:
            info = self._message(one.info)
            complete = self._complete(one.info)
            if info is not None and not complete and self._grid(info) != one.topic:
                raise CohelmError(
                    f"{one.info} names {self._grid(info)} now, and nothing came there yet"
                )
            now = self._mask(one.info) if complete else one
            if (now.kind == KEEP_OUT) != (one.kind == KEEP_OUT):
                raise CohelmError(
                    f"{one.info} was a filter of type {one.kind}, and now of one of type "
                    f"{now.kind}: start the drive again to take that up"
                )
            made.append(one if _same(now, one) else now)
        return tuple(made)

    def close(self) -> None:
        """Listen no more."""
        for end in self._ends.values():
            end()

    def _listen(self, topic: str, kind: str) -> None:
        def on_change(received: Received) -> None:
            self._received[topic] = received
            self._on_change()

        self._ends[topic] = self._transport.subscribe(topic, kind, LATCHED, on_change)

    def _message(self, topic: str) -> Any:
        """None: nothing has come that could be read."""
        received = self._received.get(topic)
        return None if received is None else received.message

    def _grid(self, info: Any) -> str:
        """The topic of the grid that a filter names; empty: an invalid name. It is subscribed to
        from now on."""
        try:
            topic = resolved(info.filter_mask_topic, self._space)
        except CohelmError:
            return ""
        if topic not in self._ends:
            self._listen(topic, GRID)
        return topic

    def _complete(self, topic: str) -> bool:
        info = self._message(topic)
        if info is None:
            return False
        if self._unusable(topic, info):  # its mask changes nothing
            return True
        return self._message(self._grid(info)) is not None

    def _unusable(self, topic: str, info: Any) -> str:
        """Why a filter can not be used, whatever its mask is; empty: it may."""
        if info.type not in (KEEP_OUT, PERCENT, SPEED):
            return (
                f"{topic} is a filter of type {info.type}, and masks are of type 0 (keep "
                f"out), 1 (speed in percent) or 2 (speed in m/s): leave it out of {_OPTION}"
            )
        if not abs(info.base) + abs(info.multiplier) <= _MOST:  # nor for NaN
            return (
                f"{topic}: base {info.base:g} and multiplier {info.multiplier:g} make no speeds: "
                "fix the parameters of costmap_filter_info_server"
            )
        if not self._grid(info):
            return (
                f"{topic} names no topic of a mask, but {info.filter_mask_topic!r}: fix mask_topic"
                " of costmap_filter_info_server"
            )
        return ""

    def _mask(self, topic: str) -> FilterMask:
        """Of one filter. CohelmError for what is missing or wrong."""
        seen, info = self._transport.endpoints(), self._message(topic)
        if info is None:
            cure = f"start costmap_filter_info_server, or name another topic with {_OPTION}"
            raise CohelmError(self._nothing_received(topic, FILTER_INFO, cure, seen))
        if said := self._unusable(topic, info):
            raise CohelmError(said)
        grid = self._grid(info)
        mask = self._message(grid)
        if mask is None:
            cure = (
                f"{topic} says that the mask is there: start a map_server with that topic_name, "
                "or fix mask_topic of costmap_filter_info_server"
            )
            raise CohelmError(self._nothing_received(grid, GRID, cure, seen))
        return FilterMask(
            topic, grid, int(info.type), float(info.base), float(info.multiplier),
            *_cells(grid, mask, self._frame),
        )  # fmt: skip

    def _nothing_received(self, topic: str, kind: str, cure: str, seen: list[Endpoint]) -> str:
        received = self._received.get(topic)
        damage = "" if received is None else received.damage
        return mismatch.nothing_received(topic, kind, LATCHED, _OPTION, seen, damage, cure)


def _same(one: FilterMask, other: FilterMask) -> bool:
    """Whether both mean the same zones; a bridge sends latched messages again."""
    about = one._replace(cells=other.cells)
    return about == other and np.array_equal(one.cells, other.cells)


def _cells(topic: str, grid: Any, frame: str) -> tuple[NDArray[np.int8], float, Pose]:
    """Cells, resolution and origin of a `nav_msgs/msg/OccupancyGrid`. CohelmError for one that can
    not be used."""
    about = grid.info
    width, height, side = int(about.width), int(about.height), float(about.resolution)
    at, turned = about.origin.position, about.origin.orientation
    origin = Pose(float(at.x), float(at.y), yaw_of(turned))
    errors, named = "", grid.header.frame_id.lstrip("/")
    if named != frame:
        errors = (
            f"it is in the frame {named!r}, and the map's is {frame!r}: set frame_id of its "
            "map_server, or name the map's with cohelm robot --map-frame"
        )
    elif len(grid.data) != width * height or not width * height:
        declared = f"{width} x {height} cells are declared"
        errors = f"{declared}, and {len(grid.data)} come: fix what publishes it"
    elif not _FINEST <= side <= _COARSEST:  # nor for NaN
        errors = f"its cells are {side:g} m wide: fix its resolution"
    elif not all(math.isfinite(value) for value in origin):
        errors = "its origin is no pose: fix the origin in its map_server's YAML file"
    elif math.hypot(turned.x, turned.y) > _FLAT:
        errors = "it is inclined, and a map lies flat: fix the orientation of its origin"
    if errors:
        raise CohelmError(f"{topic}: {errors}")
    cells = np.asarray(grid.data).astype(np.int8, copy=False).reshape(height, width)
    return cells, side, origin
