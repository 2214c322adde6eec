"""Zones of a scenario in runs, drives and records."""

from __future__ import annotations

import math
import zlib

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.frames import placed
from cohelm.core.types import Pose
from cohelm.drive.factory import simulated
from cohelm.drive.playback import Playback
from cohelm.drive.session import SessionConfig
from cohelm.drive.shown import zone_messages
from cohelm.link.bulk_messages import Zone, ZoneMap
from cohelm.plan.zones import CELL, Zones, covering
from cohelm.record.write import Recorder
from cohelm.scenario import build, load
from cohelm.scenario.model import Scenario
from cohelm.scenario.zones import ZonesModel
from cohelm.sim.run import pieces
from cohelm.study.single import scene

START = Pose(0.0, 0.0, 0.0)
ACROSS = "[[1.5, -1.5], [2.3, -1.5], [2.3, 0.1], [1.5, 0.1]]"
SLOW = "{corners_m: [[3.6, -1.5], [4.6, -1.5], [4.6, 1.5], [3.6, 1.5]], speed_mps: 0.2}"
TEXT = """
name: zoned
reference: {waypoints_m: [[0, 0], [3, 0], [5.5, 0]]}
walls_m: [[-1, -1.5, 7, -1.5], [-1, 1.5, 7, 1.5], [-1, -1.5, -1, 1.5], [7, -1.5, 7, 1.5]]
"""


def zoned_scenario(zones: str, *changes: str) -> Scenario:
    made = load.parse(f"{TEXT}zones: {zones}\n", Scenario, "zoned.yaml", changes)
    return load.standing_alone(made, load.Path())


def driven(scenario: Scenario):
    done = list(pieces(build.setup(scenario)))
    return done[0].joined(*done[1:])


def deepest(trace, scenario: Scenario) -> np.ndarray:
    """Of the outline in the keep-out zones, in each step [m]."""
    setup = build.setup(scenario)
    body, depth = covering(setup.outline, CELL), setup.pilot.zones.keep_out.depth
    rows = trace.rows[::5]
    poses = [Pose(*(float(row[name]) for name in ("x", "y", "psi"))) for row in rows]
    return np.array([depth.at(placed(body, pose)).max() for pose in poses])


@pytest.mark.parametrize("plant", ["kinematic", pytest.param("twin", marks=pytest.mark.slow)])
def test_a_run_obeys_keep_out_and_speed_zones(plant):
    chosen = f"simulation.plant={plant}"
    made = zoned_scenario(f"{{keep_out_m: [{ACROSS}], speed: [{SLOW}]}}", chosen)
    trace = driven(made)
    assert trace.rows["arrived"][-1]
    assert deepest(trace, made).max() == 0.0
    within = trace.rows[(trace.rows["x"] > 3.9) & (trace.rows["x"] < 4.3)]
    assert len(within)
    assert np.abs(within["nominal_v"]).max() <= 0.2 + 1e-6
    assert np.abs(trace.rows["nominal_v"]).max() > 0.3


def test_a_robot_that_starts_in_a_zone_leaves_it_without_going_deeper():
    made = zoned_scenario("{keep_out_m: [[[-1, -1.5], [1.2, -1.5], [1.2, 1.5], [-1, 1.5]]]}")
    trace = driven(made)
    depths = deepest(trace, made)
    assert depths[0] > 0.5
    assert depths.max() < depths[0] + 0.15
    assert depths[-1] == 0.0
    assert trace.rows["arrived"][-1]


def test_masks_take_precedence_over_the_zones_of_the_scenario():
    made = zoned_scenario(f"{{keep_out_m: [{ACROSS}], speed: [{SLOW}]}}")
    robot = type(simulated("minimal"))(made)
    zones = SessionConfig(robot).zones
    assert zones.keep_out.depth.at(np.array([(1.9, -0.5)]))[0] > 0.0
    other = ZonesModel.model_validate({"keep_out_m": [[(5, 0), (6, 0), (6, 1)]]}).read(START)
    both = SessionConfig(robot, zones=other).zones
    assert both.keep_out is other.keep_out
    assert both.slow.limit(np.array([(4.0, 0.0)])) == pytest.approx(0.2)


def test_every_cell_that_a_polygon_touches_is_marked():
    corners = [(0.013, 0.007), (1.021, 0.488), (0.502, 1.013)]
    zones = ZonesModel.model_validate({"keep_out_m": [corners]}).read(START)
    share = np.random.default_rng(4).dirichlet((0.5, 0.5, 0.5), 2000)
    assert (zones.keep_out.depth.at(share @ np.array(corners)) > 0.0).all()
    beside = np.array([(0.9, 0.2), (0.1, 0.9), (1.2, 0.5)])
    assert not zones.keep_out.depth.at(beside).any()


def test_of_overlapping_speed_zones_the_lower_limit_counts():
    wide, narrow = ([(0, 0), (2, 0), (2, 1), (0, 1)], [(1, 0), (2, 0), (2, 1), (1, 1)])
    for first, second in ((0.4, 0.1), (0.1, 0.4)):
        both = [
            {"corners_m": wide, "speed_mps": first}, {"corners_m": narrow, "speed_mps": second},
        ]  # fmt: skip
        slow = ZonesModel.model_validate({"speed": both}).read(START).slow
        assert slow.limit(np.array([(1.5, 0.5)])) == pytest.approx(0.1)
        assert slow.limit(np.array([(0.5, 0.5)])) == pytest.approx(first)


def test_zones_are_in_the_record_of_a_run_and_are_read_back(tmp_path):
    made = zoned_scenario(
        f"{{keep_out_m: [{ACROSS}], speed: [{SLOW}]}}", "simulation.duration_s=0.2"
    )
    setup = build.setup(made)
    with Recorder(tmp_path / "run.mcap", scene(setup)) as recorder:
        for piece in pieces(setup):
            recorder.write(piece)
    shown = zone_messages(setup.pilot.zones, 0.5)
    back = [n.message for n in Playback(tmp_path / "run.mcap").at(0.1)]
    back = [message for message in back if isinstance(message, ZoneMap)]
    assert [one.what for one in back] == [Zone.KEEP_OUT, Zone.SPEED]
    for one, other in zip(shown, back, strict=True):
        assert zlib.decompress(one.cells) == zlib.decompress(other.cells)
        assert other.usual == 0.5
        assert other.origin == pytest.approx(one.origin, abs=1e-6)
    assert set(zlib.decompress(back[1].cells)) == {40}
    low = back[0].origin
    assert (low.x, low.y) == pytest.approx((1.5, -1.5), abs=CELL + 1e-6)


@pytest.mark.parametrize(
    ("zones", "changes", "why"),
    [
        ("{keep_out_m: [[[0, 0], [1, 0]]]}", (), "zones.keep_out_m.0"),
        ("{keep_out_m: [[[0, 0], [1, 0], [2, 0]]]}", (), "its corners enclose nothing: give them"),
        ("{speed: [{corners_m: [[0, 0], [1, 0], [1, 1]]}]}", (), "zones.speed.0.speed_mps"),
        ("{speed: [{corners_m: [[0, 0], [1, 0], [1, 1]], speed_mps: 0}]}", (), "speed_mps"),
        (f"{{keep_out_m: [{ACROSS}], keep_out_file: a.yaml}}", (), "there is keep_out_m already"),
        (f"{{speed: [{SLOW}], speed_file: a.yaml}}", (), "there is speed already; draw all in one"),
        ("{keep_out_file: gone.yaml}", (), "zones.keep_out_file: "),
        ("{keep_out_file: /tmp}", (), "zones.keep_out_file: /tmp: is a folder, not a mask's"),
        ("{keep_outs: 1}", (), "zones.keep_outs"),
        (f"{{keep_out_m: [{ACROSS}]}}", ("law.filter=none",), "the paper's law knows no zones"),
        ("{keep_out_m: [[[0, 0], [9e4, 0], [9e4, 9e4]]]}", (), "are all corners in metres?"),
        ("{keep_out_m: [[[0, 0], [3300, 0], [3300, 1]]]}", (), "or than 65535 in a row: are all"),
    ],
)  # fmt: skip
def test_invalid_zones_are_refused_in_one_sentence(zones, changes, why):
    with pytest.raises(CohelmError) as error:
        build.setup(zoned_scenario(zones, *changes))
    assert why in str(error.value)


def test_without_zones_nothing_is_published():
    assert zone_messages(Zones(), 0.5) == ()
    assert not ZonesModel().read(START)
    assert math.isinf(build.setup(zoned_scenario("{}")).pilot.settings.fastest)
