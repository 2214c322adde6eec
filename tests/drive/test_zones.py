"""Keep-out and speed zones in whole drives, and invalid masks."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import yaml
from PIL import Image

from cohelm.core.errors import CohelmError
from cohelm.core.frames import placed
from cohelm.core.types import Pose, Stick
from cohelm.drive.factory import simulated
from cohelm.drive.operate import DriveOptions, map_and_zones
from cohelm.drive.path_check import PathChecker
from cohelm.drive.session import Session, SessionConfig, driver_of
from cohelm.link.bulk_messages import Zone, ZoneMap
from cohelm.link.messages import Mode
from cohelm.link.operator import Scripted
from cohelm.perceive.localize.map_from_geometry import map_from_geometry
from cohelm.plan.path_planner import Goal
from cohelm.plan.zones import CELL, covering
from cohelm.ros.masks import FilterMask
from cohelm.scenario.worlds.maps import read_map, read_speed_mask
from cohelm.scenario.zones import check, masked, read_zones
from tests.drive.faults import CORRIDOR, along_corridor
from tests.drive.resuming import Drive

START = Pose(0.0, 0.0, 0.0)
ACROSS = (1.5, -1.5, 2.3, 0.1)
"""Of the corridor, all but 1.4 m on the left."""


def mask(folder, *boxes, values=(), name="mask", low=(-3.0, -4.0), size=(16.0, 8.0), **keys):
    """A mask on the map: boxes (x1, y1, x2, y2) of black, or of so many percent of it."""
    side = 0.1
    pixels = np.full((round(size[1] / side), round(size[0] / side)), 255, np.uint8)
    for box, value in zip(boxes, values or [100] * len(boxes), strict=True):
        x1, y1, x2, y2 = (round(v / side) for v in np.subtract(box, (*low, *low)))
        pixels[y1:y2, x1:x2] = round(255 - 2.55 * value)
    Image.fromarray(np.flipud(pixels)).save(folder / f"{name}.png")
    about = {
        "image": f"{name}.png", "resolution": side, "origin": [*low, 0.0], "negate": 0,
        "occupied_thresh": 0.65, "free_thresh": 0.196, "mode": "trinary",
    }  # fmt: skip
    path = folder / f"{name}.yaml"
    path.write_text(yaml.safe_dump(about | keys), encoding="utf-8")
    return path


def speeds(folder, *boxes, values, **keys):
    """Of a speed filter, whose values are what they say."""
    scaled = {"name": "speed", "mode": "scale", "occupied_thresh": 1.0, "free_thresh": 0.0}
    return mask(folder, *boxes, values=values, **scaled | keys)


class Hand(Scripted):
    """Holds a stick, after half a second of letting it be; and is told all."""

    def __init__(self, stick: Stick | None) -> None:
        periods = itertools.count()
        moved = stick and (lambda _: stick if next(periods) > 25 else Stick(0.0, 0.0))
        super().__init__(moved or (lambda _: None), lambda: 0.0)
        self.told = []

    def send_status(self, status) -> None:
        self.told.append(status)


class Ride:
    """A drive along the corridor, and what was seen of it in each period."""

    def __init__(self, zones, end: float, seconds: float, stick: Stick | None = None) -> None:
        """end: of the route, along the corridor [m]. seconds: at most."""
        made = along_corridor(end)
        body, hand = covering(made.model.outline, CELL), Hand(stick)
        self.depths: list[float] = []
        """Of the true outline in keep-out zones [m]."""
        self.poses: list[Pose] = []
        with Session(SessionConfig(made, zones=zones), hand) as session:
            begun = session.loop.gated.now()

            def until(loop) -> bool:
                truth = loop.gated.truth().pose
                self.poses.append(truth)
                if zones.keep_out is not None:
                    self.depths.append(float(zones.keep_out.depth.at(placed(body, truth)).max()))
                return loop.driver.arrived or loop.gated.now() - begun > seconds

            session.run(until, Mode.AUTOMATIC if stick is None else Mode.MANUAL)
            self.arrived = session.loop.driver.arrived
            session.end("over")
        self.told = hand.told


def test_keep_out_zones_are_avoided_and_speed_zones_obeyed(tmp_path):
    slow = (3.4, -1.5, 4.0, 1.5)
    zones = read_zones(mask(tmp_path, ACROSS), speeds(tmp_path, slow, values=[40]), START)
    ride = Ride(zones, 4.6, 60.0)
    assert ride.arrived
    assert max(ride.depths) == 0.0
    within = [s for s in ride.told if 3.7 < s.pose.x < 3.9]
    assert {s.cap_reason for s in within} == {"speed zone, 40 %"}
    assert all(s.speed_cap == pytest.approx(0.2) for s in within)
    assert max(s.applied.v for s in within) < 0.2 + 1e-3
    before = [s for s in ride.told if s.pose.x < 2.8]
    assert {s.cap_reason for s in before} == {""}


def test_no_stick_motion_enters_a_keep_out_zone_and_the_reason_is_reported(tmp_path):
    zones = read_zones(mask(tmp_path, (2.0, -1.5, 4.0, 1.5)), None, START)
    ride = Ride(zones, 5.0, 6.0, Stick(1.0, 0.0))
    assert max(ride.depths) == 0.0
    assert 1.4 < ride.poses[-1].x < 2.0 - 0.36
    assert ride.told[-1].why == "limited: keep-out zone"


def test_a_robot_placed_in_a_keep_out_zone_can_only_drive_out(tmp_path):
    zones = read_zones(mask(tmp_path, (-1.0, -1.5, 1.2, 1.5)), None, START)
    ride = Ride(zones, 3.0, 40.0)
    assert ride.depths[0] > 0.5
    assert max(ride.depths) < ride.depths[0] + 0.15
    assert ride.arrived
    out = next(i for i, depth in enumerate(ride.depths) if depth == 0.0)
    assert max(ride.depths[out:]) == 0.0


def test_without_localization_no_zone_is_placed(tmp_path):
    zones = read_zones(mask(tmp_path, ACROSS), speeds(tmp_path, ACROSS, values=[40]), START)
    made = simulated(CORRIDOR, real_time=False)
    driver = driver_of(SessionConfig(made, zones=zones), real_time=False)
    with Session(SessionConfig(made, zones=zones)) as session:
        session.run(lambda loop: loop.seen is not None and not loop.seen.lost)
        seen = session.loop.seen._replace(pose=Pose(0.8, 0.0, 0.0))
        lost = seen._replace(lost=True)
        zoned = driver.with_zones(seen)
        assert len(zoned.obstacles.points) > len(seen.obstacles.points)
        assert driver.clearance(zoned) > 0.5  # of what is seen
        assert len(driver.with_zones(lost).obstacles.points) == len(lost.obstacles.points)
        assert driver.speed_zone_cap(
            seen._replace(pose=Pose(2.0, 0.0, 0.0))
        ).speed == pytest.approx(0.2)
        assert driver.speed_zone_cap(lost._replace(pose=Pose(2.0, 0.0, 0.0))).reason == ""


def test_no_path_leads_through_a_keep_out_zone(tmp_path):
    zones = read_zones(mask(tmp_path, ACROSS), None, START)
    outline = simulated(CORRIDOR).model.outline
    nothing = np.empty((0, 2))
    judge = PathChecker(0.5, outline, nothing, nothing, zones.keep_out)
    assert "an obstacle" in judge(np.array([(6.0, -0.5)]), START).why
    assert judge(Goal(6.0, -0.5), START).reference is not None
    assert judge(Goal(1.9, -0.5), START).why == "the goal 1.9, -0.5 is in a keep-out zone"


@pytest.mark.parametrize(
    ("zone", "made", "why"),
    [
        ("keep_out", {}, "no cell is occupied, so no zone is marked"),
        ("keep_out", {"boxes": ACROSS, "image": "gone.png"}, "there is no such image, but"),
        ("keep_out", {"boxes": ACROSS, "resolution": 0.0}, "resolution"),
        (
            "keep_out",
            {"boxes": ACROSS, "origin": [50.0, 0.0, 0.0]},
            "the keep-out zones lie beside the map",
        ),
        ("slow", {}, "no cell has a limit: draw zones darker, with mode: scale"),
        ("slow", {"boxes": ACROSS}, "no zone is slower than 100 %: draw them grey, with mode"),
        ("slow", {"boxes": ACROSS, "base": 100.0, "multiplier": -1.0}, "a zone has a limit of 0 %"),
        ("slow", {"boxes": ACROSS, "base": -101.0, "type": 2}, "a zone has a limit of -1 m/s"),
        ("slow", {"boxes": ACROSS, "type": 0}, "is a keep-out mask by its type"),
        (
            "slow",
            {"boxes": ACROSS, "origin": [50.0, 0.0, 0.0], "multiplier": 0.5},
            "the speed zones lie beside the map",
        ),
    ],
)
def test_a_mask_that_can_not_be_used_is_refused_in_a_sentence(tmp_path, zone, made, why):
    boxes = [made.pop("boxes")] if "boxes" in made else []
    path = mask(tmp_path, *boxes, **made)
    known = map_from_geometry(simulated(CORRIDOR).scenario.walls(), START)
    with pytest.raises(CohelmError) as error:
        check(read_zones(*((path, None) if zone == "keep_out" else (None, path)), START), known)
    assert why in str(error.value)


@pytest.mark.parametrize(("base", "multiplier", "kind"), [(100.0, -1.0, 1), (0.0, 0.01, 2)])
def test_a_mask_on_a_topic_is_the_zones_that_its_file_would_be(tmp_path, base, multiplier, kind):
    speed = {"base": base, "multiplier": multiplier, "type": kind}
    files = mask(tmp_path, ACROSS), speeds(tmp_path, ACROSS, values=[60], **speed)
    keep_out, slow = read_map(files[0]), read_speed_mask(files[1]).cells
    told = masked([
        FilterMask("/a", "/b", 0, 0.0, 1.0, keep_out.cells, keep_out.resolution, keep_out.origin),
        FilterMask("/c", "/d", kind, base, multiplier, slow.cells, slow.resolution, slow.origin),
    ])  # fmt: skip
    read = read_zones(*files, START)
    assert np.array_equal(told.keep_out.zone, read.keep_out.zone)
    assert np.array_equal(told.keep_out.depth.values, read.keep_out.depth.values)
    assert told.keep_out.depth[1:] == read.keep_out.depth[1:]
    assert np.array_equal(told.slow.limits.values, read.slow.limits.values)
    assert (told.slow.share, *told.slow.limits[1:]) == (read.slow.share, *read.slow.limits[1:])
    assert not masked([])


@pytest.mark.parametrize("value", [0, -1])
def test_a_mask_of_which_all_is_lifted_is_not_divided_into_the_cells_of_zones(value):
    """1 x 3000 cells of 100 m, that mark nothing, would be 90 GB."""
    cells = np.full((3, 2), value, np.int8)
    told = masked([FilterMask("/info", "/mask", 0, 0.0, 1.0, cells, 10.0, START)], True)
    assert told is not None
    depth, zone = told.keep_out
    assert depth.values.shape == zone.shape == (3, 2)
    assert not depth.values.any()
    assert depth.bounds().tolist() == [[0.0, 0.0], [20.0, 30.0]]


@pytest.mark.parametrize(
    ("kind", "values", "why"),
    [
        (0, 60, "/mask (named by /info): no cell is occupied, so no zone is marked"),
        (1, 0, "/mask (named by /info): no cell has a limit"),
        (1, 100, "/mask (named by /info): no zone is slower than 100 %"),
        (2, -1, "/mask (named by /info): no cell has a limit"),
    ],
)
def test_a_mask_on_a_topic_that_marks_nothing_is_refused_in_a_sentence(kind, values, why):
    cells = np.full((3, 4), values, np.int8)
    with pytest.raises(CohelmError) as error:
        masked([FilterMask("/info", "/mask", kind, 0.0, 1.0, cells, 0.1, START)])
    assert str(error.value).startswith(why)


def test_a_file_and_a_topic_can_not_define_zones_of_one_kind(tmp_path):
    made = simulated(CORRIDOR)
    cells = np.full((3, 4), 100, np.int8)
    told = [FilterMask("/info", "/mask", 0, 0.0, 1.0, cells, 0.1, START)]
    named = DriveOptions(str(CORRIDOR), "", "kinematic", True, None, [])
    slow = speeds(tmp_path, ACROSS, values=[60], type=2, multiplier=0.01)
    with pytest.raises(CohelmError, match="--keep-out and --masks-from define the same zones"):
        map_and_zones(named._replace(keep_out=mask(tmp_path, ACROSS)), made, told)
    _, zones = map_and_zones(named._replace(speed_zones=slow), made, told)
    assert zones.keep_out is not None
    assert zones.slow is not None


def test_zones_need_a_map_and_accept_the_type_of_nav2(tmp_path):
    zones = read_zones(mask(tmp_path, ACROSS), None, START)
    with pytest.raises(CohelmError, match="there is none to localise on: give one with --map"):
        check(zones, None)
    assert not read_zones(None, None, START)
    half = speeds(tmp_path, ACROSS, values=[50], base=100.0, multiplier=-1.0)
    absolute = speeds(tmp_path, ACROSS, values=[50], name="metres", type=2, multiplier=0.01)
    body = np.array([(1.9, -0.5)])
    share = read_zones(None, half, START).slow
    assert (share.share, share.limit(body)) == (True, pytest.approx(0.5, abs=0.01))
    metres = read_zones(None, absolute, START).slow
    assert (metres.share, metres.limit(body)) == (False, pytest.approx(0.5, abs=0.01))


def test_without_zones_stations_receive_empty_zones(tmp_path):
    with Drive(tmp_path) as drive:
        told = drive.link.bulk._published
    for zone in Zone:
        assert (told[ZoneMap, zone].columns, told[ZoneMap, zone].rows) == (0, 0)
