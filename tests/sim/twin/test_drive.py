"""Runs with the twin as the plant: the law in the loop, recorded as any other run."""

import itertools
import math
from collections.abc import Iterator

import numpy as np
import pytest
from PIL import Image

from cohelm.core.trace import Trace
from cohelm.core.types import Pose, Twist
from cohelm.law.guard.bounds import braked
from cohelm.pilot.margin_inflation import SLOP
from cohelm.robot.achievable import achievable
from cohelm.robot.kinematics import arc
from cohelm.scenario import build, load
from cohelm.sim.run import pieces, run
from cohelm.sim.twin.drive import held
from cohelm.sim.twin.robot import Twin
from cohelm.sim.twin.settings import TwinModel, lag
from cohelm.study.metrics import measure
from tests.few import first
from tests.sim.twin.drives import sally

ON_THE_TWIN = ["simulation.plant=twin", "simulation.step_s=0.02", "law.filter=guard"]
DT = 0.02


def driven(name: str, *changes: str) -> Trace:
    return run(build.setup(load.scenario(name, [*ON_THE_TWIN, *changes])))


@pytest.mark.parametrize(
    ("change", "seeds"),  # who sees the truth has no noise
    first(
        [
            ("senses=lidar", 3),
            ("simulation.twin.friction=0.15", 1),
            ("senses=lidar", 5),
            ("senses=truth", 1),
        ],
        2,
    ),
    ids=str,
)
def test_the_lab_is_driven_without_a_contact(change, seeds):
    drives = [
        driven("lab-avoid", "simulation.wheel_limits=true", change, f"simulation.seed={seed}")
        for seed in range(seeds)
    ]
    for trace in drives:
        assert measure(trace).reached
        assert trace.rows["clearance"].min() > 0.04
    # Whether it meets the mover before, in or behind the door (60, 75 or 95 s) is noise.
    assert np.median([trace.rows["t"][-1] for trace in drives]) < 80.0


def test_on_ice_the_guard_counts_on_no_more_than_the_floor_holds():
    limits = sally().bounds()
    assert held(limits, TwinModel()).wheel_acceleration == limits.wheel_acceleration
    slippery = held(limits, TwinModel(friction=0.1))
    assert slippery.wheel_acceleration < 0.1 * 9.81
    assert slippery.speed == limits.speed


def test_the_same_seed_makes_the_same_run():
    changes = ("senses=lidar", "simulation.duration_s=4")
    first, again = (driven("lab-avoid", *changes).rows.tobytes() for _ in range(2))
    assert first == again


def test_a_run_in_pieces_is_the_run_at_once():
    setup = build.setup(load.scenario("lab-avoid", [*ON_THE_TWIN, "simulation.duration_s=3"]))
    parts: Iterator[Trace] = pieces(setup, 40)
    first, *rest = parts
    assert first.joined(*rest).rows.tobytes() == run(setup).rows.tobytes()
    assert len(first) == 40


def test_the_recorded_applied_twist_leads_from_pose_to_pose():
    rows = driven("lab-avoid", "simulation.duration_s=6").rows
    for a, b in itertools.pairwise(rows):
        there = arc(Pose(a["x"], a["y"], a["psi"]), Twist(a["applied_v"], a["applied_omega"]), DT)
        assert math.hypot(there.x - b["x"], there.y - b["y"]) < 1e-3
        assert there.psi == pytest.approx(b["psi"], abs=1e-3)


def test_the_papers_law_drives_the_twin_too():
    trace = driven("lab-track", "law.filter=none", "simulation.duration_s=20")
    assert trace.rows["e_p"].max() < 0.5
    assert (trace.rows["rate"] == 1.0).all()  # its reference runs on with time
    assert len(trace) == 1001


def test_wheel_limits_can_not_be_switched_off_and_one_is_told():
    scenario = load.scenario("lab-track", [*ON_THE_TWIN, "simulation.wheel_limits=false"])
    assert any("wheel_limits" in told for told in build.warnings(scenario))


def test_stops_end_where_the_guard_foretells_them():
    """Assumptions 2 and 3 of the guard, with the delay that `lag` tells and room for SLOP."""
    model, physics = sally(), TwinModel()
    limits, steps = model.bounds(), round(lag(model, physics, DT) / DT)
    rng = np.random.default_rng(5)
    for _ in range(12):
        robot = Twin(model, settings=physics)
        command, sent = Twist(0.0, 0.0), [Twist(0.0, 0.0)] * (steps + 1)
        for k in range(int(rng.integers(40, 90))):
            if k % 15 == 0:
                wish = Twist(*(rng.uniform(-1.0, 1.0, 2) * (limits.speed, limits.yaw_rate)))
            command = achievable(wish, command, limits, DT)
            robot.send(command)
            sent.append(command)
            robot.wait(robot.now() + DT)
        pose, twist, orders = robot.truth().pose, sent[-steps - 1], sent[-steps:]
        while orders[-1] != Twist(0.0, 0.0):
            orders.append(braked(orders[-1], limits, DT))
        foretold = [pose]
        for order in orders:
            twist = achievable(order, twist, limits, DT)
            foretold.append(arc(foretold[-1], twist, DT))
        for k in range(1, len(foretold)):
            robot.send(orders[min(k - 1 + steps, len(orders) - 1)])
            robot.wait(robot.now() + DT)
            assert apart(robot.truth().pose, foretold[k], model.outline) < SLOP


def apart(a: Pose, b: Pose, outline: np.ndarray) -> float:
    def placed(pose: Pose) -> np.ndarray:
        c, s = math.cos(pose.psi), math.sin(pose.psi)
        return outline @ np.array([[c, s], [-s, c]]) + np.array(pose[:2])

    return float(np.hypot(*(placed(a) - placed(b)).T).max())


def test_a_map_is_driven_in_and_its_walls_are_as_hard(tmp_path):
    solid = np.full((60, 160), 254, dtype=np.uint8)
    solid[:3], solid[-3:], solid[:, :3], solid[:, -3:] = 0, 0, 0, 0
    solid[20:40, 70:75] = 0
    Image.fromarray(solid).save(tmp_path / "room.pgm")
    (tmp_path / "room.yaml").write_text(
        "image: room.pgm\nresolution: 0.05\norigin: [0.0, 0.0, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    (tmp_path / "scenario.yaml").write_text(
        "name: map\nworld: {kind: map, file: room.yaml}\nstart: {x_m: 1, y_m: 1, heading_rad: 0}\n"
        "reference: {waypoints_m: [[1, 1], [3, 1], [5, 1], [7, 1]]}\n"
    )
    trace = run(build.setup(load.scenario(tmp_path / "scenario.yaml", ON_THE_TWIN)))
    assert trace.rows["arrived"][-1]
    assert 0.02 < trace.rows["clearance"].min() < 0.6
