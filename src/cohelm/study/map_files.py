"""Writes what a mapping came to: the grid as map_server reads it, trajectory, loops and picture."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cohelm.core.files import whole, write_json, writing
from cohelm.core.types import Floats, Pose
from cohelm.perceive.map.mapper import MappingResult, encounters
from cohelm.perceive.map.raster import Raster
from cohelm.scenario.worlds.maps import FREE, OCCUPIED, UNKNOWN, OccupancyMap, write_map
from cohelm.study.localized_drive import LocalizedDrive
from cohelm.study.mapping_session import MappingSession, Mark


@dataclass(frozen=True)
class MapResult:
    """The outcome, for people or programs."""

    scans: int
    empty_scans: int
    """Without a single return."""
    record_whole: bool
    """Whether the record was finished; from a damaged one the map is made as far as it goes."""
    places: int
    loops: int
    encounters: int
    """Times that the robot came back to where it had been, each with some loops."""
    marks: tuple[str, ...]
    """The errors marked, as on the command line."""
    odometry_scale: float
    travelled_m: float
    width_m: float
    height_m: float
    resolution_m: float
    seconds: float
    left_out: str = ""
    """What of the record could not be used, and how much; empty: nothing."""
    localized: LocalizedDrive | None = None
    """The drive again, on the map that was made of it, if that was asked for."""


def occupancy(drawn: Raster) -> OccupancyMap:
    """The grid as map_server publishes it."""
    occupied = drawn.occupied()
    cells = np.where(occupied, OCCUPIED, np.where(drawn.free(), FREE, UNKNOWN)).astype(np.int8)
    return OccupancyMap(cells, drawn.resolution, drawn.origin, from_start=True)


def outcome(
    session: MappingSession, made: MappingResult, drawn: Raster, seconds: float, left_out: str
) -> MapResult:
    """Of what was mapped and drawn, in so many seconds."""
    path = np.array([pose[:2] for pose in made.poses])
    rows, columns = drawn.hits.shape
    return MapResult(
        scans=len(made.poses), empty_scans=session.empty, record_whole=session.whole,
        places=len(made.places), loops=len(made.loops), encounters=len(encounters(made)),
        marks=tuple(_as_option(mark) for mark in session.marks), odometry_scale=made.scale,
        travelled_m=float(np.hypot(*np.diff(path, axis=0).T).sum()),
        width_m=columns * drawn.resolution, height_m=rows * drawn.resolution,
        resolution_m=drawn.resolution, seconds=seconds, left_out=left_out,
    )  # fmt: skip


def _as_option(mark: Mark) -> str:
    """A mark as on the command line."""
    if mark.kind == "remove-loop":
        a, b = (round(value) for value in mark.values[0])
        return f"--remove-loop between scans {a} and {b}"
    return f"--{mark.kind} {':'.join(f'{value:g}' for value in mark.values[0])}"


def write(
    folder: Path, session: MappingSession, made: MappingResult, drawn: Raster, result: MapResult
) -> None:
    """All but the session itself. CohelmError where the folder can not be written."""
    with writing(folder):
        write_map(folder, occupancy(drawn))
        stamps = np.array(session.stamps)
        rows = np.column_stack((stamps, np.array(made.poses)))
        np.savetxt(
            folder / "trajectory.csv", rows, "%.6f", ",", header="t_s,x_m,y_m,psi_rad", comments=""
        )
        _save_loops(folder / "loops.csv", encounters(made), stamps - stamps[0], made.poses)
    write_result(folder, result)
    show(folder, made, drawn)


def write_result(folder: Path, result: MapResult) -> None:
    """mapping.json. CohelmError where the folder can not be written."""
    with writing(folder):
        write_json(folder / "mapping.json", asdict(result))


def show(folder: Path, made: MappingResult, drawn: Raster) -> None:
    """map.png, put in place whole, for a viewer that shows it anew. CohelmError where the folder
    can not be written."""
    with writing(folder), whole(folder / "map.png") as new:
        picture(new, drawn, made.poses, encounters(made))


def _save_loops(
    path: Path, met: list[list[tuple[int, int]]], since: Floats, poses: list[Pose]
) -> None:
    """Each time that the robot came back: when it was there, when it came again, and where."""
    rows = ["loop,from_s,to_s,again_from_s,again_to_s,x_m,y_m,pairs"]
    for number, pairs in enumerate(met, 1):
        ends = np.array(pairs)
        first, again = since[ends[:, 0]], since[ends[:, 1]]
        at = poses[pairs[len(pairs) // 2][1]]
        rows.append(
            f"{number},{first.min():.1f},{first.max():.1f},{again.min():.1f},{again.max():.1f},"
            f"{at.x:.2f},{at.y:.2f},{len(pairs)}"
        )
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")


def shades(
    occupied: NDArray[np.bool_], free: NDArray[np.bool_], most: int
) -> tuple[NDArray[np.uint8], int]:
    """Occupied cells black, free ones white, others grey, in at most so many pixels either way; how
    many cells are a pixel, either way. A wall of one cell is black in a small picture, too."""
    cells = max(1, math.ceil(max(occupied.shape) / most))
    rows, columns = (cells * math.ceil(n / cells) for n in occupied.shape)

    def any_of(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
        padded = np.zeros((rows, columns), np.bool_)
        padded[: mask.shape[0], : mask.shape[1]] = mask
        blocks = padded.reshape(rows // cells, cells, columns // cells, cells)
        return np.asarray(blocks.any(axis=(1, 3)), dtype=np.bool_)

    shown = np.where(any_of(occupied), 0, np.where(any_of(free), 255, 190))
    return shown.astype(np.uint8), cells


def picture(path: Path, drawn: Raster, poses: list[Pose], met: list[list[tuple[int, int]]]) -> None:
    """The map with the way driven, and the loops that were closed, by their numbers."""
    from matplotlib.figure import Figure

    shown, cells = shades(drawn.occupied(), drawn.free(), 700)
    rows, columns = shown.shape
    x, y, r = drawn.origin.x, drawn.origin.y, cells * drawn.resolution
    wide = 7.0
    figure: Any = Figure(figsize=(wide, min(max(wide * rows / columns, 3.0), 12.0)), dpi=90)
    axes = figure.subplots()
    axes.imshow(
        shown, origin="lower", cmap="gray", vmin=0, vmax=255,
        extent=(x, x + columns * r, y, y + rows * r),
    )  # fmt: skip
    way = np.array([pose[:2] for pose in poses])
    every = max(1, sum(map(len, met)) // 200)
    for number, pairs in enumerate(met, 1):
        for a, b in pairs[::every]:
            axes.plot(way[[a, b], 0], way[[a, b], 1], color="tab:orange", linewidth=0.5)
        at = way[pairs[len(pairs) // 2][1]]
        axes.annotate(
            str(number), at, color="tab:red", fontsize=7, xytext=(3, 3),
            textcoords="offset points", clip_on=True,
        )  # fmt: skip
    axes.plot(way[:, 0], way[:, 1], color="tab:blue", linewidth=0.8)
    axes.plot(way[0, 0], way[0, 1], "o", color="tab:green", markersize=4)
    axes.set_xlim(x, x + columns * r)
    axes.set_ylim(y, y + rows * r)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    figure.tight_layout()
    figure.savefig(path, format="png")  # by its name it is not yet one
