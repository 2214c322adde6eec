"""Occupancy maps of ROS map_server: a YAML file beside a PGM or PNG image."""

from __future__ import annotations

import io
import math
import re
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, BinaryIO, Literal, Self

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from cohelm.core.errors import CohelmError
from cohelm.core.files import check_regular
from cohelm.core.frames import compose
from cohelm.core.types import Pose
from cohelm.perceive.localize.localization_map import LocalizationMap, map_from_occupancy
from cohelm.perceive.match.surfaces import MOST_CELLS
from cohelm.scenario.worlds.file import contents, faults
from cohelm.sim.grid import Grid, grid

FREE, OCCUPIED, UNKNOWN = 0, 100, -1
"""Values of a cell, as in nav_msgs/OccupancyGrid; scale and raw maps have 1 ... 99 as well."""

PICTURES = (".png", ".pgm", ".jpg", ".jpeg", ".bmp")
"""How the name of a map's picture may end."""
_ABSOLUTE = 2
_HEADER = re.compile(rb"P5" + 3 * rb"(?:\s|#[^\n]*\n)+(\d+)" + rb"\r(?=\n)")
"""Of a PGM whose header ends in CRLF: width, height, most."""
_FINEST, _COARSEST = 1e-4, 1.0  # sides of a cell; larger than a robot, it shows no way [m]
_FARTHEST = 1e9  # of an origin: coordinates of a state's survey are there too [m]
Number = Annotated[float, Field(allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]


@dataclass(frozen=True)
class OccupancyMap:
    """What map_server publishes."""

    cells: NDArray[np.int8]
    """(rows, columns), row 0 at the smallest y of the map's own axes."""
    resolution: float
    """Side of a cell [m]."""
    origin: Pose
    """Pose of the outer corner of cell (0, 0), in the map's frame."""
    from_start: bool = False
    """Whether that frame is the pose at which the robot that made it began, as `cohelm map` has it;
    else it is the world's, as a published map's is."""

    def grid(self, unknown_is_solid: bool = False) -> Grid:
        """The same for the simulator: occupied cells are solid, and unknown ones on request."""
        solid = self.cells >= OCCUPIED
        if unknown_is_solid:
            solid |= self.cells == UNKNOWN
        return grid(solid, self.resolution, self.origin)

    def placed(self, start: Pose) -> OccupancyMap:
        """The same in the world's frame. start: the robot's first pose."""
        if not self.from_start:
            return self
        return replace(self, origin=compose(start, self.origin), from_start=False)

    def known(self) -> LocalizationMap:
        """The same for localisation. CohelmError where nothing is occupied, or nothing free."""
        return map_from_occupancy(
            self.cells >= OCCUPIED, self.cells == FREE, self.resolution, self.origin
        )


class _Description(BaseModel):
    """The keys of a map_server YAML file; others are of no concern here."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    image: Annotated[str, Field(min_length=1)]
    resolution: Annotated[Number, Field(gt=0.0)]
    origin: Annotated[list[Number], Field(min_length=2, max_length=3)]
    cohelm_frame: Literal["map", "start"] = "map"
    negate: bool = False
    occupied_thresh: Share = 0.65
    free_thresh: Share = 0.196
    mode: Literal["trinary", "scale", "raw"] = "trinary"
    type: Literal[0, 1, 2] = 1
    base: Number = 0.0
    multiplier: Number = 1.0

    @model_validator(mode="after")
    def _sound(self) -> Self:
        if not _FINEST <= self.resolution <= _COARSEST:
            why = f"resolution is the side of a cell in metres, got {self.resolution:g}"
            if self.resolution > _COARSEST:
                why += (
                    f", and one of more than {_COARSEST:g} m is larger than a robot: divide "
                    "centimetres by 100, millimetres by 1000"
                )
            raise ValueError(why)
        x, y, yaw = (*self.origin, 0.0)[:3]
        if not (abs(x) <= _FARTHEST and abs(y) <= _FARTHEST and abs(yaw) <= 4.0 * math.pi):
            raise ValueError(f"origin is x and y in metres and a yaw in radians, got {self.origin}")
        if self.free_thresh >= self.occupied_thresh:
            raise ValueError("free_thresh must be smaller than occupied_thresh")
        return self


@dataclass(frozen=True)
class SpeedMask:
    """What Nav2's speed filter is given: a mask, and how its values are speeds."""

    cells: OccupancyMap
    absolute: bool
    """Whether the limits are m/s (Nav2's type 2) and not percent (type 1)."""
    base: float
    multiplier: float

    def limits(self) -> NDArray[np.float32]:
        """base + multiplier * value, (rows, columns), in percent or m/s; 0 where there is none: of
        the value 0, and of unknown cells."""
        values = self.cells.cells
        made = self.base + self.multiplier * values.astype(np.float32)
        return np.where(values > 0, made, 0.0).astype(np.float32)

    def checked(self, name: str) -> SpeedMask:
        """The same. CohelmError, with the name of the mask, where it has no limit, or one that is
        none."""
        some = self.cells.cells > 0
        if not some.any():
            raise CohelmError(f"{name}: no cell has a limit: draw zones darker, with mode: scale")
        limits = self.limits()[some]
        if not (limits > 0.0).all() or not np.isfinite(limits).all():
            least = float(limits.min())
            limit = f"{least:g} m/s" if self.absolute else f"{least:g} %"
            raise CohelmError(
                f"{name}: a zone has a limit of {limit}, which is no speed (Nav2 takes 0 for no "
                "limit): use a keep-out mask for where nothing may drive, or fix base, multiplier "
                "and mode (scale)"
            )
        return self


def read_speed_mask(path: Path | str) -> SpeedMask:
    """A mask of speed limits, read as a map: in its YAML file may be `type`, `base` and
    `multiplier` too, as the costmap filter info server of Nav2 has them.

    Raises CohelmError as `read_map`, and for a limit that is none.
    """
    about, cells = _read(path)
    if about.type == 0:
        raise CohelmError(f"{path}: is a keep-out mask by its type, 0: use --keep-out, or type 1")
    return SpeedMask(cells, about.type == _ABSOLUTE, about.base, about.multiplier).checked(
        str(path)
    )


def read_map(path: Path | str) -> OccupancyMap:
    """A map from its YAML file; the image's path is relative to it.

    With p the darkness of a pixel (its lightness if `negate`), as nav2's map_server reads it:
    *trinary*: occupied from occupied_thresh, free up to free_thresh, else unknown;
    *scale*: the same, 1 ... 99 in between, unknown where the image is not opaque;
    *raw*: the pixel's own value, unknown above 100.

    Raises CohelmError where either file is missing, damaged, too large or makes no sense.
    """
    return _read(path)[1]


def is_from_start(path: Path | str) -> bool:
    """Whether a map's frame is the pose at which its robot began, see `OccupancyMap.from_start`.
    Raises CohelmError where its YAML file is missing or makes no sense."""
    return _described(path).cohelm_frame == "start"


def _described(path: Path | str) -> _Description:
    try:
        raw = yaml.safe_load(contents(path, "a map_server YAML file"))
        if not isinstance(raw, dict) or not {"image", "resolution"} & raw.keys():
            raise CohelmError(
                f"{path}: has no keys such as image and resolution: give a map_server YAML file"
            )
        return _Description.model_validate(raw)
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        if Path(path).suffix.lower() in PICTURES:
            raise CohelmError(
                f"{path}: is a picture: give the YAML file that goes with it, which says its scale"
            ) from error
        if getattr(error, "encoding", "") == "utf-8":
            raise CohelmError(f"{path}: is not text in UTF-8: save it as that") from error
        mark = getattr(error, "problem_mark", None)
        where = "" if mark is None else f":{mark.line + 1}"
        why = "is not YAML"
        if isinstance(error, RecursionError):
            why = "is nested too deeply"
        elif "'\\t'" in str(getattr(error, "problem", "")):
            why = "has a tab, and YAML is indented with spaces"
        raise CohelmError(f"{path}{where}: {why}: give a map_server YAML file") from error
    except ValidationError as error:
        raise faults(path, error) from error


def _read(path: Path | str) -> tuple[_Description, OccupancyMap]:
    about = _described(path)
    lightness, opaque = _pixels(Path(path).parent / about.image, str(path))
    p = lightness if about.negate else 1.0 - lightness
    low, high = about.free_thresh, about.occupied_thresh
    if about.mode == "raw":
        value = np.rint(255.0 * lightness)
        cells = np.where(value <= OCCUPIED, value, UNKNOWN)
    else:
        between: NDArray[np.float32] | int = UNKNOWN
        if about.mode == "scale":
            between = np.clip(np.rint(100.0 * (p - low) / (high - low)), 1, 99)
        cells = np.where(p >= high, OCCUPIED, np.where(p <= low, FREE, between))
        if about.mode == "scale":
            cells = np.where(opaque, cells, UNKNOWN)
    x, y, yaw = (*about.origin, 0.0)[:3]
    # an image's first row is its top, a map's first row its bottom
    found = np.flipud(cells).astype(np.int8)
    from_start = about.cohelm_frame == "start"
    return about, OccupancyMap(found, about.resolution, Pose(x, y, yaw), from_start)


def write_map(folder: Path, made: OccupancyMap) -> None:
    """map.yaml and map.pgm into a folder, as map_server saves them: 0 occupied, 254 free, 205 not
    known. What is there already is replaced; OSError where the folder can not be written."""
    pixels = np.full(made.cells.shape, 205, dtype=np.uint8)
    pixels[made.cells == FREE] = 254
    pixels[made.cells >= OCCUPIED] = 0
    Image.fromarray(np.flipud(pixels)).save(folder / "map.pgm")
    x, y, yaw = (round(value, 6) for value in made.origin)
    about = {
        "image": "map.pgm", "mode": "trinary", "resolution": made.resolution,
        "origin": [x, y, yaw], "negate": 0, "occupied_thresh": 0.65, "free_thresh": 0.196,
        "cohelm_frame": "start" if made.from_start else "map",
    }  # fmt: skip
    (folder / "map.yaml").write_text(yaml.safe_dump(about, sort_keys=False), encoding="utf-8")


def _without_cr(file: BinaryIO) -> BinaryIO:
    """A PGM image without the CR before its pixels, as programs on Windows write it: of CRLF, the
    second would be taken for the first pixel. Any other image as it is."""
    header = _HEADER.match(file.read(4096))
    file.seek(0)
    if header is None:
        return file
    width, height = int(header[1]), int(header[2])
    data = file.read(header.end() + 1 + min(width * height, MOST_CELLS))
    if len(data) <= header.end() + width * height:  # the LF is its first pixel
        return io.BytesIO(data)
    return io.BytesIO(data[: header.end() - 1] + data[header.end() :])


def _pixels(path: Path, named_in: str) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Lightness in [0, 1], the mean of the colours, and where the image is opaque."""
    try:
        check_regular(path)
        with warnings.catch_warnings():
            # the limit below is lower than the one that is warned of
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with path.open("rb") as file, Image.open(_without_cr(file)) as image:
                width, height = image.size
                if width * height > MOST_CELLS:
                    raise CohelmError(
                        f"{path}: {width} x {height} cells are more than {MOST_CELLS}; "
                        "use a coarser map or cut it"
                    )
                if image.mode[0] in "IF":
                    raise CohelmError(f"{path}: has more than 8 bits per pixel; save it with 8")
                if image.mode in ("1", "L"):
                    grey = np.asarray(image.convert("L"), dtype=np.float32) / 255.0
                    return grey, np.ones(grey.shape, dtype=np.bool_)
                colours = np.asarray(image.convert("RGBA"))
    except FileNotFoundError as error:
        raise CohelmError(
            f"{path}: there is no such image, but {named_in} names it; correct its `image`"
        ) from error
    except Image.DecompressionBombError as error:
        raise CohelmError(
            f"{path}: has more cells than the {MOST_CELLS} that a map may have; use a coarser map "
            "or cut it"
        ) from error
    except (OSError, ValueError, SyntaxError) as error:
        raise CohelmError(
            f"{path}: is not a whole PGM or PNG image; save it again as one of them"
        ) from error
    mean = colours[:, :, :3].mean(axis=2, dtype=np.float32) / np.float32(255.0)
    return mean, colours[:, :, 3] == 255
