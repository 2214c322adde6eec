"""Camera pictures of the twin in records."""

import io
import time
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from cohelm.core.types import Pose
from cohelm.drive.factory import Simulated, simulated
from cohelm.drive.pictures import Pictures
from cohelm.drive.session import Session, SessionConfig
from cohelm.link.messages import Mode
from cohelm.record.messages import messages
from cohelm.record.replay import Replayed
from cohelm.record.topics import IMAGE
from cohelm.robot.keep.gated_robot import rules
from cohelm.robot.keep.process import RemoteGatedRobot
from cohelm.robot.keep.record_pipe import LARGEST
from cohelm.robot.port import Frame
from cohelm.robot.sensors import CameraModel
from cohelm.sim.twin.camera import Eye
from tests.drive.faults import CORRIDOR
from tests.few import first
from tests.link.ends import until

SMALL = CameraModel(width=64, height=48, rate_hz=10.0)


def with_camera(real_time: bool = False) -> Simulated:
    made = simulated(CORRIDOR, "twin", real_time=real_time, seed=1)
    robot = made.model.model_copy(update={"camera": SMALL})
    return replace(made, scenario=made.scenario.model_copy(update={"robot": robot}))


@pytest.mark.parametrize("rate", first([5.0, 0.0]))
def test_a_drive_of_the_twin_holds_its_pictures(rate, tmp_path):
    record = tmp_path / "drive.mcap"
    with Session(SessionConfig(with_camera(), record=record, pictures=rate)) as session:
        end = session.loop.gated.now() + 2.0
        session.run(lambda loop: loop.gated.now() >= end, Mode.AUTOMATIC)
        assert session.loop.log.dropped == 0
    seen = [(stamp, m) for _, stamp, m in messages(record, (IMAGE,))]
    assert len(seen) == pytest.approx(2.0 * rate, abs=1)
    for stamp, m in seen:
        assert m.format == "jpeg"
        assert stamp == m.header.stamp.sec * 10**9 + m.header.stamp.nanosec
        with Image.open(io.BytesIO(bytes(m.data))) as image:
            assert image.size == (64, 48)
    again = Replayed(record)
    again.wait(1.5)
    frame = again.read().frame
    assert (frame is None) == (rate == 0.0)
    if frame is not None:
        assert frame.pixels.shape == (48, 64, 3)
        assert 1.0 < frame.stamp <= 1.5


@pytest.fixture
def drawn(monkeypatch) -> list[float]:
    """Times of the pictures that a simulated camera has drawn."""
    stamps: list[float] = []
    draw = Eye._drawn
    monkeypatch.setattr(
        Eye, "_drawn", lambda eye, shot: stamps.append(shot.stamp) or draw(eye, shot)
    )
    return stamps


@pytest.mark.slow  # a drive holds its pictures: above
@pytest.mark.parametrize(("rate", "count"), first([(5.0, 5), (0.0, 0)]))
def test_for_a_record_pictures_are_drawn_at_its_rate(drawn, tmp_path, rate, count):
    plan = SessionConfig(with_camera(), record=tmp_path / "drive.mcap", pictures=rate)
    with Session(plan) as session:
        session.run(lambda loop: loop.gated.now() >= 1.1)
    assert len(drawn) == pytest.approx(count, abs=1)


def test_pictures_are_drawn_only_while_somebody_looks(drawn):
    """... and nobody who comes back sees an old one."""
    got: list[tuple[float, float]] = []
    with Session(SessionConfig(with_camera())) as session:

        def until(t: float) -> None:
            session.run(lambda loop: loop.gated.now() >= t)

        until(0.5)
        assert drawn == []
        looks = True
        session.shown = lambda packed, age: got.append((packed.stamp, age))
        session.watched = lambda: looks
        until(1.5)
        assert len(got) == len(drawn) == pytest.approx(10, abs=1)
        looks = False
        until(2.5)
        assert len(drawn) <= 11
        looks = True
        until(3.5)
    assert len(got) == len(drawn) == pytest.approx(20, abs=2)
    assert not [stamp for stamp, _ in got if 1.6 < stamp < 2.5]
    assert max(age for _, age in got) < 0.11


@pytest.mark.slow  # in simulated time: above
@pytest.mark.xdist_group("realtime")
def test_in_the_gate_process_too_pictures_are_drawn_on_request():
    made = with_camera(real_time=True)
    gated = RemoteGatedRobot(made.maker(), rules(made.model, 0.02))
    try:
        begun = time.monotonic()
        while time.monotonic() < begun + 0.5:
            assert gated.read().frame is None
            time.sleep(0.02)
        gated.draw_at(10.0)
        until(lambda: gated.read().frame is not None)
    finally:
        gated.close()


def test_a_frame_waiting_for_compression_is_replaced_by_a_newer_one():
    pictures = Pictures(waits=False)
    try:
        pose = simulated(CORRIDOR).start
        for number in range(50):
            grey = np.full((480, 640, 3), number, dtype=np.uint8)
            pictures.give(Frame(0.1 * number, number, grey), pose)
        got = []
        until(lambda: got.append(pictures.take()) or (got[-1] and got[-1].number == 49), 30.0)
        numbers = [packed.number for packed in got if packed]
        assert numbers == sorted(set(numbers))
        with Image.open(io.BytesIO(got[-1].data)) as image:
            assert abs(int(np.asarray(image)[0, 0, 0]) - 49) < 3
    finally:
        pictures.close()


@pytest.mark.parametrize("size", [(480, 640), (1080, 1920), (2, 9000)])
def test_no_picture_is_too_large_for_the_record(size):
    """Leaves and gravel are as hard to pack as noise; a record without them is not whole."""
    noise = np.random.default_rng(1).integers(0, 256, (*size, 3), dtype=np.uint8)
    pictures = Pictures(waits=True)
    pictures.give(Frame(1.0, 1, noise), Pose(0.0, 0.0, 0.0))
    packed = pictures.take()
    assert len(packed.data) < LARGEST - 1000
    with Image.open(io.BytesIO(packed.data)) as seen:
        assert seen.size[0] >= min(size[1], 480)
