"""The bench compares what can be compared, and says what it could not. No time is judged here."""

from __future__ import annotations

import io
import json
import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from rich.console import Console

from benchmarks.bench.compare import bench, world_question
from benchmarks.bench.measure import Rounds
from benchmarks.bench.peers import _NEEDS, INSTALL, Peer, PeerFailed, installed
from benchmarks.bench.scene import course, field
from cohelm.core.types import SAFE, Desired, Pose, Stick, Twist, X, Y, disc, discs
from cohelm.law.barrier import barrier
from cohelm.law.gains import Gains
from cohelm.law.step import step
from cohelm.robot.kinematics import arc
from cohelm.sim.run import run

needs_cbfpy = pytest.mark.skipif(
    not installed("qpax"), reason="the peer cbfpy is not installed: uv sync --extra peers"
)
needs_ir_sim = pytest.mark.skipif(
    not installed("ir-sim"), reason="the peer ir-sim is not installed: uv sync --extra peers"
)


def tiny(**options):
    return bench(sizes=(4, 16), rounds=2, **options)


def shown(result) -> str:
    text = io.StringIO()
    Console(width=160, file=text).print(result.table())
    return text.getvalue()


def test_an_absent_peer_is_null_and_the_table_says_how_to_get_it(monkeypatch):
    for name in _NEEDS:
        monkeypatch.setitem(_NEEDS, name, ("not_on_any_index",))
    result = tiny()
    found = json.loads(json.dumps(result.as_json(), allow_nan=False))
    assert found["peers"] == {
        "cbfpy_step_us": None, "cbfpy_elastiqp_step_us": None, "ir_sim_steps_per_s": None,
    }  # fmt: skip
    assert set(found["absent"].values()) == {INSTALL}
    assert set(found["ratios"].values()) == {None}
    text = " ".join(shown(result).split())
    for peer in ("cbfpy, qpax", "cbfpy, elastiqp", "ir-sim"):
        assert f"{peer}: {INSTALL}" in text


def test_the_bench_has_every_promised_number():
    found = tiny(peers=()).as_json()
    assert list(found["step_us"]) == ["4", "16"]
    numbers = [*found["step_us"].values(), found["run_steps_per_s"], found["guarded_steps_per_s"]]
    assert all(math.isfinite(number) and number > 0.0 for number in numbers)
    for name in ("step_us", "run_steps_per_s", "guarded_steps_per_s"):
        assert found["spread"][name]
    assert found["machine"]["cores"] >= 1
    assert found["machine"]["numba"]


def test_a_peer_that_fails_is_reported_with_its_own_error():
    with Peer("qpax") as peer, pytest.raises(PeerFailed, match=r"qpax failed: .*Error"):
        peer.ask({"time": 7, "calls": 1})  # no filter for 7 discs was made


def test_a_peer_that_dies_is_reported():
    with Peer("ir-sim") as peer:
        peer._process.kill()
        peer._process.wait()
        with pytest.raises(PeerFailed, match="ended unasked"):
            peer.ask({"run": True})


@given(
    ratio=st.floats(0.01, 100.0),
    pace=st.lists(st.floats(0.1, 10.0), min_size=3, max_size=9),
    burst=st.floats(1.0, 1e6),
)
def test_neither_a_slow_machine_nor_one_disturbed_round_moves_a_ratio(ratio, pace, burst):
    ours = Rounds(tuple(pace))
    theirs = Rounds((pace[0] * ratio * burst, *(p * ratio for p in pace[1:])))
    assert theirs.times(ours) == pytest.approx(ratio)


@pytest.mark.parametrize("n", [4, 16, 256])
def test_timed_poses_are_safe_and_some_of_them_need_the_filter(n):
    scene = field(n)
    assert scene.discs.shape == (n, 6)
    for pose in scene.poses:
        clearance = np.hypot(scene.discs[:, X] - pose.x, scene.discs[:, Y] - pose.y)
        assert (clearance > scene.discs[:, SAFE]).all()
    assert 0.1 < scene.shaped < 0.9


HEAD_ON = discs(disc(0.0, 0.0, 0.1, 0.2))


def least_h(command, steps: int = 400, dt: float = 0.02) -> float:
    """Smallest h on the way from 2 m before the disc, almost straight at it, at 0.5 m/s."""
    pose, least = Pose(-2.0, 0.02, 0.0), math.inf
    for _ in range(steps):
        pose = arc(pose, command(pose), dt)
        least = min(least, pose.x**2 + pose.y**2 - HEAD_ON[0, SAFE] ** 2)
    return least


@needs_cbfpy
@pytest.mark.parametrize("backend", ["qpax", "elastiqp"])
def test_cbfpy_keeps_the_same_distance_from_the_same_disc(backend):
    if not installed(backend):
        pytest.skip(f"cbfpy's backend {backend} is not installed: uv sync --extra peers")
    wish = [0.5, 0.0]

    def filtered(pose: Pose) -> Twist:
        return Twist(*peer.ask({"filter": 1, "pose": list(pose), "wish": wish})["command"])

    with Peer(backend) as peer:
        scene = {"discs": [[0.0, 0.0, 0.2]], "poses": [[-2.0, 0.0, 0.0]], "wishes": [wish]}
        peer.ask({"field": 1, **scene})
        assert least_h(filtered) >= 0.0
    assert least_h(lambda pose: Twist(*wish)) < 0.0


@needs_cbfpy
def test_cbfpy_passes_a_free_command_as_ours_does():
    pose, wish = Pose(-9.0, 0.3, 0.4), Twist(0.5, 0.1)
    scene = {"discs": [[0.0, 0.0, 0.2]], "poses": [list(pose)], "wishes": [list(wish)]}
    with Peer("qpax") as peer:
        peer.ask({"field": 1, **scene})
        passed = peer.ask({"filter": 1, "pose": list(pose), "wish": list(wish)})["command"]
    assert passed == pytest.approx(list(wish), abs=1e-3)  # its default tolerance
    assert barrier(pose, wish, HEAD_ON, Gains()).input == Twist(0.0, 0.0)


def test_our_step_keeps_the_distance_required_of_the_peer():
    def ours(pose: Pose) -> Twist:
        done = step(pose, Desired(pose.x, pose.y, 0.0, 0.5, 0.0), Stick(0.0, 0.0), HEAD_ON)
        return Twist(done.safe_v, done.safe_omega)

    assert least_h(ours) > 0.0


@needs_ir_sim
def test_ir_sim_drives_the_path_of_our_run():
    setup = course(10.0)
    trace = run(setup)
    end = trace.rows[-1]
    with Peer("ir-sim") as peer:
        peer.ask(world_question(setup, trace))
        first, second = peer.ask({"run": True}), peer.ask({"run": True})
    assert first["pose"] == second["pose"]  # every round starts at the start
    # ir-sim's step is Euler's, ours an exact arc; it also acts on the last row's command
    assert first["pose"][:2] == pytest.approx([end["x"], end["y"]], abs=0.02)
