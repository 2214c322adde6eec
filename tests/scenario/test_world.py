"""The key `world:` of a scenario."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from cohelm.core.errors import CohelmError
from cohelm.scenario import build, load
from cohelm.sim.run import run
from cohelm.study.metrics import measure

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
needs_barn = pytest.mark.skipif(
    not (DATA / "barn").is_dir(), reason="the BARN worlds are not beside this checkout"
)
HEAD = "name: theirs\nrobot: jackal\nsimulation: {step_s: 0.02}\nlaw: {tracking: {k_psi: 3}}\n"


def written(folder, text):
    file = folder / "mine.yaml"
    file.write_text(HEAD + text)
    return file


def refused(folder, text):
    with pytest.raises(CohelmError) as caught:
        build.setup(load.scenario(written(folder, text)))
    return str(caught.value)


@pytest.fixture
def office(tmp_path):
    """A room of 6 x 3 m in cells of 5 cm, a wall across it with a gap of 1 m at the top."""
    cells = np.full((60, 120), 254, dtype=np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = 0
    cells[20:, 58:62] = 0  # rows of an image run downwards
    Image.fromarray(cells).save(tmp_path / "office.png")
    (tmp_path / "office.yaml").write_text(
        "image: office.png\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return tmp_path


THROUGH = (
    "reference: {waypoints_m: [[1, 1], [3, 1], [5, 1]]}\nworld: {kind: map, file: office.yaml}\n"
)


@pytest.mark.parametrize("senses", ["truth", "lidar"])
def test_on_a_map_the_robot_plans_a_path_around_a_wall(office, senses):
    made = build.setup(load.scenario(written(office, THROUGH + f"senses: {senses}\n")))
    metrics = measure(run(made))
    assert metrics.reached
    assert metrics.min_clearance_m > 0.01


def test_a_start_in_a_solid_cell_is_refused(office):
    said = refused(office, THROUGH.replace("[[1, 1]", "[[0.01, 0.01]"))
    assert "stands" in said
    assert "the world's file" in said


def test_a_changed_world_file_is_refused_by_its_digest(office):
    made = load.scenario(written(office, THROUGH))
    (office / "again.yaml").write_text(load.dump(made))
    again = load.scenario(office / "again.yaml")
    assert again == made
    assert again.world is not None
    assert again.world.sha256 is not None
    with (office / "office.yaml").open("a") as file:
        file.write("# changed\n")
    with pytest.raises(CohelmError, match=r"office.yaml: the world has changed"):
        load.scenario(office / "again.yaml")


PEOPLE = "t,id,x,y\n" + "".join(
    f"{10 + 0.4 * k:.1f},ann,{4 - 0.4 * k:.2f},0.1\n{10 + 0.4 * k:.1f},bob,3,{2 - 0.2 * k:.2f}\n"
    for k in range(25)
)


def test_recorded_people_walk_through_the_run(tmp_path):
    (tmp_path / "people.csv").write_text(PEOPLE)
    text = (
        "reference: {waypoints_m: [[0, 0], [3, 0], [5, 0]]}\n"
        "world: {kind: tracks, file: people.csv, radius_m: 0.2}\n"
    )
    made = build.setup(load.scenario(written(tmp_path, text)))
    assert made.names == ("person ann", "person bob")
    trace = run(made)
    assert trace.discs[50, 0, :2] == pytest.approx([3.0, 0.1], abs=1e-6)  # 1 s into the run
    moving = np.abs(trace.rows["applied_v"]) + np.abs(trace.rows["applied_omega"]) > 0.0
    assert trace.rows["clearance"][moving].min() > 0.0
    assert measure(trace).reached


def test_people_recorded_in_unix_time_begin_where_that_is_said(tmp_path):
    rows = (f"{1_700_000_000 + 0.4 * k:.1f},ann,{4 - 0.4 * k:.2f},0.1\n" for k in range(25))
    (tmp_path / "people.csv").write_text("t,id,x,y\n" + "".join(rows))
    text = (
        "reference: {waypoints_m: [[0, 2], [3, 2], [5, 2]]}\n"
        "world: {kind: tracks, file: people.csv, begin_s: 1700000002}\n"
    )
    trace = run(build.setup(load.scenario(written(tmp_path, text))))
    assert trace.discs[0, 0, :2] == pytest.approx([2.0, 0.1], abs=1e-6)


BOX = """<sdf version="1.6"><world name="w">
<model name="crate"><static>1</static><pose>3 0 0.5 0 0 0</pose><link name="l">
<collision name="c"><geometry><box><size>0.4 0.4 1</size></box></geometry>
</collision></link></model>
<model name="pole"><static>1</static><pose>5 0.3 0.5 0 0 0</pose><link name="l">
<collision name="c"><geometry><cylinder><radius>0.1</radius><length>1</length></cylinder></geometry>
</collision></link></model></world></sdf>"""


def test_obstacles_of_a_gazebo_world_are_avoided(tmp_path):
    (tmp_path / "crate.world").write_text(BOX)
    text = (
        "reference: {waypoints_m: [[0, 0], [3, 0], [7, 0]]}\n"
        "world: {kind: gazebo, file: crate.world}\nsenses: lidar\n"
    )
    trace = run(build.setup(load.scenario(written(tmp_path, text))))
    assert measure(trace).reached
    assert trace.rows["clearance"].min() > 0.01
    assert np.abs(trace.rows["y"]).max() > 0.3


@needs_barn
def test_a_barn_world_comes_with_route_start_goal_and_time(tmp_path):
    folder = DATA / "barn" / "raw"
    text = (
        "reference: {speed_mps: 1.0}\nsenses: lidar\n"
        f"world: {{kind: gazebo, file: {folder}/world_60.world.gz, "
        f"path_file: {folder}/path_60.npy}}\n"
    )
    one = load.scenario(written(tmp_path, text))
    assert one.start is not None
    assert one.start.y_m == 3.0
    assert (one.reference.arrive_m, one.simulation.duration_s) == (1.0, 100.0)
    text = (
        "reference: {speed_mps: 1.0}\nsenses: lidar\n"
        f"world: {{kind: barn, file: {DATA}/barn/worlds.json, number: 60}}\n"
    )
    other = load.scenario(written(tmp_path, text))
    assert np.allclose(other.reference.waypoints_m, one.reference.waypoints_m, atol=2e-3)
    trace = run(build.setup(one))
    assert measure(trace).reached
    assert trace.rows["to_go"][-1] < 1.0
    assert not measure(trace).contact


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("reference: {}\nworld: {kind: map, file: x.yaml}\n", "waypoints_m: is missing"),
        ("reference: {}\n", "reference.waypoints_m: is missing"),
        ("reference: {}\nworld: {kind: barn, file: worlds.json}\n", "world.number: is missing"),
        (
            "reference: {}\nworld: {kind: barn, file: worlds.json, number: 3}\n",
            "worlds.json: no such file",
        ),
        ("reference: {}\nworld: {kind: barn, file: /tmp, number: 3}\n", "/tmp: is a folder; name"),
        ("reference: {}\nworld: {kind: gazbo, file: x}\n", "did you mean gazebo?"),
        ("reference: {}\nworld: {file: x}\n", "kind is missing; one of barn, gazebo, map, tracks"),
        (
            "reference: {waypoints_m: [[0, 0], [1, 0]]}\nworld: {kind: tracks, file: mine.yaml}\n",
            "has no column",
        ),
        (
            "reference: {waypoints_m: [[0, 0], [1, 0]]}\nsenses: lidar\nlaw: {filter: barrier}\n",
            "senses: the paper's law knows no LiDAR",
        ),
        (
            "reference: {waypoints_m: [[0, 0], [1, 0]]}\n"
            "robot: {name: blind, footprint_m: [[1, 0], [0, 1], [-1, 0]], track_m: 1, "
            "wheel_radius_m: 0.1}\nsenses: lidar\n",
            "blind has no LiDAR",
        ),
    ],
)
def test_scenarios_that_can_not_run_are_reported(tmp_path, text, said):
    if "robot:" in text:
        file = tmp_path / "mine.yaml"
        file.write_text(HEAD.replace("robot: jackal\n", "") + text)
        with pytest.raises(CohelmError, match=said):
            build.setup(load.scenario(file))
    else:
        assert said in refused(tmp_path, text)


def test_the_nearest_file_name_is_suggested(office):
    said = refused(office, THROUGH.replace("office.yaml", "ofice.yaml"))
    assert "did you mean office.yaml?" in said
