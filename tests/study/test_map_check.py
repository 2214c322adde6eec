"""What a map is good for: counted on maps of which it is known."""

import math

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose
from cohelm.robot.sensors import LidarModel
from cohelm.scenario.worlds.maps import FREE, OCCUPIED, UNKNOWN, OccupancyMap
from cohelm.study import map_check
from cohelm.study.map_check import MapCheck, checked, write

CELL = 0.05
LIDAR = LidarModel(beams=720, field_of_view_deg=360.0, range_max_m=10.0, noise_m=0.01)


def room(width: float, height: float, wall: float = 0.15) -> np.ndarray:
    """Cells of an empty room, and its walls around it; 1 m of unknown ground around them."""
    w, h, t, around = (round(x / CELL) for x in (width, height, wall, 1.0))
    cells = np.full((h + 2 * (t + around), w + 2 * (t + around)), UNKNOWN, np.int8)
    cells[around:-around, around:-around] = OCCUPIED
    cells[around + t : -around - t, around + t : -around - t] = FREE
    return cells


HERE = Pose(0.0, 0.0, 0.0)


def check(cells: np.ndarray, origin: Pose = HERE, places: int = 40) -> MapCheck:
    return checked(OccupancyMap(cells, CELL, origin), LIDAR, lambda *_: None, places=places)


def with_niches(cells: np.ndarray) -> np.ndarray:
    """The room with boxes in it, so that every place is one of a kind."""
    made = cells.copy()
    for x, y, w, h in ((1.5, 1.5, 0.8, 0.3), (4.0, 1.3, 0.4, 1.0), (2.2, 4.3, 1.1, 0.5)):
        i, j = round(y / CELL), round(x / CELL)
        made[i : i + round(h / CELL), j : j + round(w / CELL)] = OCCUPIED
    return made


def test_a_room_with_different_corners_is_good_everywhere():
    found = check(with_niches(room(5.0, 4.0)))
    assert found.places == 40
    assert found.few_features == ()
    assert found.alike == ()
    assert found.open_m == 0.0


def test_an_empty_room_looks_the_same_turned_round():
    found = check(room(5.0, 4.0))
    assert len(found.alike) > 0.9 * found.places
    for pose, other in found.alike:
        middle = np.array([1.15 + 2.5, 1.15 + 2.0])
        mirrored = 2.0 * middle - np.array(pose[:2])
        assert np.hypot(*(mirrored - np.array(other[:2]))) < 0.2
        assert abs(math.remainder(other.psi - pose.psi - math.pi, math.tau)) < 0.1


def test_in_the_middle_of_a_long_corridor_there_are_too_few_features():
    found = check(room(60.0, 2.0))
    x = [pose.x for pose in found.few_features]
    assert len(x) > 0.4 * found.places
    assert min(x) > 1.15 + 9.0  # nearer, the LiDAR sees the end
    assert max(x) < 1.15 + 51.0


@pytest.mark.parametrize("wall", [0.05, 0.15, 0.3])
def test_walls_are_as_thick_and_as_long_as_drawn(wall):
    found = check(with_niches(room(5.0, 4.0, wall)), places=1)
    assert found.thickness_m == pytest.approx(wall)
    assert found.thickness_95_m >= 0.3  # the boxes
    around, boxes = 2.0 * (5.0 + 4.0), 2.0 * (0.8 + 0.3 + 0.4 + 1.0 + 1.1 + 0.5)
    assert found.wall_m == pytest.approx(around + boxes, abs=1.5)


def test_a_door_to_unknown_ground_is_an_open_end():
    cells = with_niches(room(5.0, 4.0))
    cells[20:23, 60:80] = FREE  # a door of 1 m in the lower wall
    found = check(cells, places=1)
    assert found.open_m == pytest.approx(1.0)


def test_the_frame_of_the_map_does_not_matter():
    cells = room(5.0, 4.0)
    here, there = check(cells), check(cells, Pose(30.0, -7.0, 0.7))
    assert len(here.alike) == len(there.alike)
    assert here.wall_m == there.wall_m


def test_a_map_without_a_free_place_is_refused():
    cells = room(5.0, 4.0)
    cells[cells == FREE] = UNKNOWN
    with pytest.raises(CohelmError, match="free"):
        check(cells)


def test_the_time_for_a_large_map_is_bounded(monkeypatch):
    """By the places that are searched, which are counted before any is."""
    cells = room(5.0, 4.0)
    with monkeypatch.context() as small:
        small.setattr(map_check, "_SEARCHED", 3_000)
        assert 3 <= check(cells).places <= 8  # 25 for each of some 17 m2
    monkeypatch.setattr(map_check, "_MOST_SEARCHED", 100)
    with pytest.raises(CohelmError, match=r"places of the map are free, and 100 are the most"):
        check(cells)


def test_it_is_written_with_a_picture(tmp_path):
    cells = room(5.0, 4.0)
    occupancy = OccupancyMap(cells, CELL, Pose(1.0, 2.0, 0.3))
    found = checked(occupancy, LIDAR, lambda *_: None, places=5)
    write(tmp_path / "made", occupancy, found)
    assert (tmp_path / "made" / "check.png").stat().st_size > 5_000
    assert '"places": 5' in (tmp_path / "made" / "check.json").read_text(encoding="utf-8")
    with pytest.raises(CohelmError, match="--out"):
        write(tmp_path / "made" / "check.png", occupancy, found)
