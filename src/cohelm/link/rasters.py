"""Maps and zones with wider cells, where they are too large to be sent or drawn."""

from __future__ import annotations

import zlib
from typing import TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from cohelm.link.bulk_messages import LARGEST_BULK, Map, Zone, ZoneMap

T = TypeVar("T")

MOST_ALONG, MOST_CELLS = 16_384, 2**24
"""Cells along one side, and of all, that every browser draws as one picture: a canvas of more is
empty in some, without an error. A site of 200 m has 16 million cells of 5 cm."""
_MOST_PACKED = LARGEST_BULK - 1000


def drawable(message: T) -> T:
    """The same for a page: a map or zones with cells twice as wide, as often as needed."""
    shown: object = message
    while isinstance(shown, Map | ZoneMap) and not _drawn_as_one(shown):
        shown = coarser(shown)
    return cast(T, shown)


def _drawn_as_one(shown: Map | ZoneMap) -> bool:
    rows, columns = shown.rows, shown.columns
    if isinstance(shown, Map):
        rows, columns = max(rows, shown.height), max(columns, shown.width)
    fits = max(rows, columns) <= MOST_ALONG and rows * columns <= MOST_CELLS
    return fits and len(shown.cells) <= _MOST_PACKED


def coarser(shown: Map | ZoneMap) -> Map | ZoneMap:
    """The same with cells twice as wide, of a whole map or of zones. Of four cells: occupied or in
    a zone where one is, and as slow as the slowest; else free where one is."""
    rows, columns = -(-shown.rows // 2), -(-shown.columns // 2)
    cells = np.frombuffer(zlib.decompress(shown.cells), dtype=np.uint8)
    cells = cells.reshape(shown.rows, shown.columns)
    side = 2.0 * shown.resolution
    if isinstance(shown, Map):  # unknown is -1, below free
        packed = _packed(cells.view(np.int8), rows, columns, -1)
        return shown._replace(
            resolution=side, width=columns, height=rows, columns=columns, rows=rows, cells=packed
        )
    if shown.what == Zone.KEEP_OUT:
        packed = _packed(cells.view(np.int8), rows, columns, 0)
    else:  # the slowest of those that are speeds at all
        slowness = np.where(cells > 0, 101 - cells.astype(np.int8), 0).astype(np.int8)
        packed = _packed(slowness, rows, columns, 0, turned=True)
    return shown._replace(resolution=side, columns=columns, rows=rows, cells=packed)


def _packed(
    cells: NDArray[np.int8], rows: int, columns: int, beyond: int, turned: bool = False
) -> bytes:
    """The greatest of each four cells, packed. beyond: where there are none. turned: what is above
    0 means 101 less it."""
    padded = np.full((2 * rows, 2 * columns), beyond, dtype=np.int8)
    padded[: cells.shape[0], : cells.shape[1]] = cells
    coarse = padded.reshape(rows, 2, columns, 2).max(axis=(1, 3))
    if turned:
        coarse = np.where(coarse > 0, 101 - coarse, 0).astype(np.int8)
    return zlib.compress(coarse.view(np.uint8).tobytes())
