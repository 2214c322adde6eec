"""Docks of a scenario, and refused ones."""

from __future__ import annotations

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose
from cohelm.perceive.localize.map_from_geometry import map_from_geometry
from cohelm.plan.zones import UNZONED
from cohelm.robot.model import RobotModel
from cohelm.scenario import load
from cohelm.scenario.docks import DockModel, checked, no_room
from cohelm.scenario.model import Scenario
from cohelm.scenario.zones import ZonesModel

ROOM = np.array([(-2, -2, 3, -2), (3, -2, 3, 2), (3, 2, -2, 2), (-2, 2, -2, -2)], dtype=float)
START = Pose(0.0, 0.0, 0.0)
HARD = 0.071


@pytest.fixture(scope="module")
def room():
    return map_from_geometry(ROOM, START)


@pytest.fixture(scope="module")
def outline():
    robot = load.load_robot("sally")
    assert isinstance(robot, RobotModel)
    return robot.outline


def dock(**changed) -> DockModel:
    keys = {"name": "charger", "x_m": 2.5, "y_m": 0.0, "heading_rad": 0.0, "margin_m": 0.08}
    return DockModel.model_validate(keys | changed)


def test_a_dock_with_enough_clearance_is_accepted(room, outline):
    (made,) = checked([dock()], outline, HARD, room, UNZONED)
    assert made.name == "charger"
    assert made.pose == (2.5, 0.0, 0.0)
    assert made.staging == pytest.approx((1.5, 0.0, 0.0))


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"margin_m": 0.05}, "dock charger: margin_m is 0.05, less than the 0.071 m that this"),
        ({"x_m": 2.8}, "the docked robot would stand in a wall: correct its pose"),
        ({"x_m": 2.62}, "docked the robot has 2 cm to a wall, less than margin_m, 0.08"),
        (
            {"x_m": -1.5, "approach_m": 2.0},
            "its approach's beginning, at -3.50, 0.00, is not where",
        ),
        ({"x_m": 12.0}, "the docked robot, at 12.00, 0.00, is not where the map knows of free"),
        ({"x_m": 0.0, "y_m": 1.65}, "the robot has 6 cm to a wall"),
    ],
)
def test_an_impossible_dock_is_refused_in_one_sentence(room, outline, changed, said):
    with pytest.raises(CohelmError) as refused:
        checked([dock(**changed)], outline, HARD, room, UNZONED)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_an_approach_through_a_wall_is_refused(outline):
    """A thin wall across it, with a door elsewhere."""
    across = np.array([(1.2, -1.0, 1.2, 1.0)])
    known = map_from_geometry(np.vstack((ROOM, across)), START)
    with pytest.raises(
        CohelmError, match=r"on its approach, at .*, the robot has nothing to a wal"
    ):
        checked([dock(approach_m=1.5)], outline, HARD, known, UNZONED)


def test_a_dock_in_a_keep_out_zone_is_refused(room, outline):
    corners = [(1.8, -0.1), (2.0, -0.1), (2.0, 0.1)]
    zones = ZonesModel.model_validate({"keep_out_m": [corners]}).read(START)
    with pytest.raises(CohelmError, match="its approach leads through a keep-out zone"):
        checked([dock()], outline, HARD, room, zones)


def test_a_dock_without_a_map_is_refused(outline):
    with pytest.raises(CohelmError, match="docks stand on the map, and there is none"):
        checked([dock()], outline, HARD, None, UNZONED)
    assert checked([], outline, HARD, None, UNZONED) == ()


ONE = "{name: charger, x_m: 2, y_m: 0, heading_rad: 0, margin_m: 0.1}"


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            [f"docks=[{ONE}, {ONE}]"],
            "docks.1.name: dock 1 is called 'charger' too; names must diff",
        ),
        (
            [f"docks=[{ONE}]", "law.filter=barrier"],
            "docks: the paper's law knows no docks; set law.",
        ),
        (["docks=[{name: a, x_m: 2, y_m: 0, heading_rad: 0}]"], "margin_m: is missing: Clearance"),
        (["docks=[{name: a, x_m: 2, y_m: 0, heading_rad: 0, margin_m: 0}]"], "must be > 0"),
        (["docks=[{name: a, x: 2}]"], "unknown key; did you mean x_m"),
    ],
)
def test_an_invalid_dock_is_refused_with_its_key(changes, said):
    with pytest.raises(CohelmError) as refused:
        load.scenario("minimal", changes)
    assert said in str(refused.value)


def test_docks_are_read_back_from_a_record():
    made = load.scenario("dock")
    again = load.parse(load.dump(made), Scenario, "again")
    assert again.docks == made.docks
    assert [one.name for one in made.docks] == ["charger"]


@pytest.mark.parametrize("resolution", [0.02, 0.1, 0.2])
def test_a_wall_within_the_outline_refuses_a_dock_on_a_coarse_map(outline, resolution):
    in_the_way = np.array([(1.9, 0.0)])
    said = no_room(dock().dock(), outline, in_the_way, resolution)
    assert said.startswith("on its approach, at 1.54, 0.00, the robot has nothing to a wall")
    assert no_room(dock().dock(), outline, np.array([(1.9, 0.5)]), resolution) == ""
