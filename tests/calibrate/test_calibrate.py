"""Calibration, on robots whose numbers it does not know. Seeds 1 and 2 were looked at while it was
written; from 1700 on they are used for counting only."""

import math
from pathlib import Path

import pytest
import yaml

from cohelm.calibrate.excitation import excitation
from cohelm.calibrate.mount import mount
from cohelm.calibrate.response import response
from cohelm.calibrate.rewrite import rewritten
from cohelm.calibrate.ride import PERIOD, ride
from cohelm.calibrate.verdict import findings
from cohelm.core.errors import CohelmError
from cohelm.robot.keep.gated_robot import GatedRobot, rules, standing
from cohelm.robot.model import shipped_path
from cohelm.scenario.load import load_robot
from tests.calibrate.hidden import Hidden, drawn, ridden


def errors(seed, kind):
    made, (model, true, scale, lag), _ = ridden(seed, kind)
    assert made.ended == ""
    answered, placed = response(model, made), mount(model, made)
    by_key = {one.key: one for one in findings(model, answered, placed)}
    track = by_key["track_m"].measured.value
    brake = answered.straight.brake.value * placed.way.value
    return {
        "total_ms": 1e3 * (answered.total.value - true.delay_s - lag),
        "brake": brake / true.limits.wheel_acceleration_mps2 - 1.0,
        "x_mm": 1e3 * (placed.x.value - true.lidar.mount_x_m),
        "y_mm": 1e3 * (placed.y.value - true.lidar.mount_y_m),
        "yaw_deg": math.degrees(placed.yaw.value) - true.lidar.mount_yaw_deg,
        "way": placed.way.value / scale - 1.0,
        "track": track / true.track_m - 1.0,
    }


def held(found, step_ms=0.0):
    assert abs(found["total_ms"]) < 5.0 + step_ms
    assert abs(found["brake"]) < 0.05
    assert abs(found["x_mm"]) < 10.0
    assert abs(found["y_mm"]) < 10.0
    assert abs(found["yaw_deg"]) < 0.5
    assert abs(found["way"]) < 0.01
    assert abs(found["track"]) < 0.01


def test_a_hidden_robot_is_measured():
    held(errors(1, "kinematic"))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1700, 1710))
@pytest.mark.parametrize("kind", ["kinematic", "twin"])
def test_many_hidden_robots_are_measured(kind, seed):
    # the twin's drives heed an order one step of physics later
    held(errors(seed, kind), 5.0 if kind == "twin" else 0.0)


class Silent(Hidden):
    """Its LiDAR says nothing."""

    def read(self):
        return super().read()._replace(scan=None)


class Lame(Hidden):
    """It does not move."""

    def send(self, twist):
        return twist


class Backwards(Hidden):
    """Its clock jumps back after a while."""

    def now(self):
        now = self.inside.now()
        return now if now < 1.0 else now - 0.6


@pytest.mark.parametrize(
    ("kind", "said"), [(Silent, "no scan came"), (Lame, "it was told"), (Backwards, "clock")]
)
def test_what_can_not_be_measured_gets_a_sentence(kind, said):
    model, true, scale, _ = drawn(1, "kinematic")
    robot = kind(model, true, 1, "kinematic", scale)
    keeper = GatedRobot(robot, rules(model, PERIOD), watched_by=())
    with pytest.raises(CohelmError, match=said):
        ride(keeper, excitation(model))
    assert standing(robot.inside.truth().twist)


def test_an_obstacle_on_the_floor_is_seen_before_anything_moves():
    model, true, scale, _ = drawn(1, "kinematic")
    keeper = GatedRobot(Hidden(model, true, 1, "kinematic", scale), rules(model, PERIOD))
    plan = excitation(model)._replace(length=6.0)
    with pytest.raises(CohelmError, match="within the free floor"):
        ride(keeper, plan)
    assert keeper.truth().pose[:2] == (0.0, 0.0)


def test_an_interrupt_stops_the_robot_and_keeps_what_was_measured():
    model, true, scale, _ = drawn(1, "kinematic")
    robot = Hidden(model, true, 1, "kinematic", scale)
    keeper = GatedRobot(robot, rules(model, PERIOD))
    made = ride(keeper, excitation(model), lambda: "Ctrl-C" if keeper.now() > 6.0 else "")
    assert made.ended == "Ctrl-C"
    assert made.segments
    assert standing(robot.inside.truth().twist)


def test_too_short_a_floor_is_refused_with_what_is_needed():
    with pytest.raises(CohelmError, match="at least"):
        excitation(load_robot("husky"), 0.8)


def test_a_file_keeps_its_comments_and_gets_its_numbers():
    text = Path(shipped_path("sally")).read_text(encoding="utf-8")
    made = rewritten(text, {"delay_s": 0.081, "lidar.mount_x_m": 0.31, "lidar.mount_yaw_deg": 1.5})
    assert "# Sensors of the kinds" in made
    data = yaml.safe_load(made)
    assert (data["delay_s"], data["lidar"]["mount_x_m"]) == (0.081, 0.31)
    assert data["lidar"]["mount_yaw_deg"] == 1.5
    data["delay_s"], data["lidar"]["mount_x_m"] = 0.05, 0.30
    del data["lidar"]["mount_yaw_deg"]
    assert data == yaml.safe_load(text)
