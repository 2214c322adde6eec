"""The camera sees the scene, whoever draws, and drawing changes nothing else."""

import math
import sys
import time

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.types import Twist
from cohelm.robot.clock import WallClock
from cohelm.sim.twin.camera import RayCamera, camera
from cohelm.sim.twin.robot import Twin
from tests.sim.twin.drives import disc, drive, sally, scene


def with_cone(kind: str = "rays", **more) -> Twin:
    obstacles = scene(disc(1.5, 0.0, 0.1), walls=[[5.0, -4.0, 5.0, 4.0]])
    return Twin(
        sally(camera={"width": 160, "height": 120}), obstacles=obstacles, camera=kind, **more
    )


def orange(pixels: np.ndarray) -> np.ndarray:
    r, g, b = (pixels[..., i].astype(int) for i in range(3))
    return (r > 2 * g - 20) & (r > 3 * b) & (r > 120)


@pytest.fixture
def gl() -> None:
    try:
        camera(Twin(sally(), camera="none").mujoco, 32, 32, "gl").close()
    except CohelmError as error:
        pytest.skip(str(error))


def cone_seen(kind: str) -> np.ndarray:
    robot = with_cone(kind)
    robot.wait(0.1)
    frame = robot.read().frame
    robot.close()
    assert frame is not None
    assert frame.pixels.shape == (120, 160, 3)
    assert frame.pixels.dtype == np.uint8
    return orange(frame.pixels)


def test_rays_see_the_cone_ahead():
    seen = cone_seen("rays")
    rows, columns = np.nonzero(seen)
    assert 100 < len(rows) < 3000
    assert abs(columns.mean() - 79.5) < 2.0


@pytest.mark.usefixtures("gl")
def test_opengl_and_rays_see_the_same():
    drawn, cast = cone_seen("gl"), cone_seen("rays")
    assert (drawn & cast).sum() > 0.7 * (drawn | cast).sum()  # its edges are many of its pixels
    for axis in (0, 1):
        assert abs(np.nonzero(drawn)[axis].mean() - np.nonzero(cast)[axis].mean()) < 1.0


@pytest.mark.usefixtures("gl")
@pytest.mark.parametrize("far", [6.0, 300.0])
def test_a_wall_right_before_the_camera_hides_all_else_however_large_the_world_is(far):
    walls = [[0.38, -2.0, 0.38, 2.0], [far, -far, far, far]]
    at = {"width": 160, "height": 120, "mount_x_m": 0.25, "mount_z_m": 0.3}
    robot = Twin(sally(camera=at), obstacles=scene(walls=walls), camera="gl")
    robot.wait(0.1)
    frame = robot.read().frame
    robot.close()
    assert frame is not None
    ahead = frame.pixels[:90].astype(int)  # all but what stands before the wall's foot
    assert np.ptp(ahead, axis=(0, 1)).max() < 40  # one surface, no sky and no floor behind it


def test_what_is_to_the_left_is_on_the_left():
    robot = Twin(
        sally(camera={"width": 160, "height": 120}), obstacles=scene(disc(1.5, 0.4, 0.1)),
        camera="rays",
    )  # fmt: skip
    robot.wait(0.1)
    frame = robot.read().frame
    assert frame is not None
    assert np.nonzero(orange(frame.pixels))[1].mean() < 60


def test_without_opengl_ray_casting_takes_over_with_a_warning(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco.egl", None)
    robot = with_cone("auto")
    robot.wait(0.1)
    assert robot.read().frame is not None
    assert robot._eye is not None
    assert isinstance(robot._eye._camera, RayCamera)


def test_requesting_opengl_without_it_names_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco.egl", None)
    robot = with_cone("gl")
    robot.wait(0.1)
    with pytest.raises(CohelmError, match=r"install libegl1 and libgl1"):
        robot.read()


def test_frames_come_at_their_rate_and_do_not_change_the_drive():
    seen, blind = with_cone("rays", seed=1), with_cone("none", seed=1)
    frames = {}
    for _ in range(60):
        for robot in (seen, blind):
            robot.send(Twist(0.3, 0.1))
            robot.wait(robot.now() + 0.02)
        frame = seen.read().frame
        assert frame is not None
        frames[frame.number] = frame.stamp
    assert blind.read().frame is None
    assert sorted(frames) == list(range(len(frames)))
    assert len(frames) == 19  # 15 a second from 0 to 1.2
    assert all(abs(stamp - number / 15.0) <= 0.005 for number, stamp in frames.items())
    assert seen.truth() == blind.truth()
    assert seen.read().odometry == blind.read().odometry


def test_pictures_are_drawn_as_often_as_requested_and_none_where_nobody_looks(monkeypatch):
    robot, drawn = with_cone("rays"), []
    draw = RayCamera.draw
    monkeypatch.setattr(RayCamera, "draw", lambda *a: drawn.append(robot.now()) or draw(*a))

    def in_a_second(rate: float) -> list[float]:
        begun = robot.now()
        robot.draw_at(rate)
        drawn.clear()
        stamps = set()
        for k in range(1, 101):
            robot.wait(begun + 0.01 * k)
            frame = robot.read().frame
            assert (frame is not None) <= (rate > 0.0)
            stamps |= set() if frame is None or frame.stamp <= begun else {frame.stamp}
        assert len(drawn) == len(stamps)
        return sorted(stamps)

    assert in_a_second(0.0) == []
    assert np.allclose(np.diff(in_a_second(5.0)), 0.2)
    assert len(in_a_second(math.inf)) == 15  # the camera's rate
    assert in_a_second(0.0) == []


@pytest.mark.xdist_group("realtime")
def test_in_real_time_a_thread_of_its_own_draws_and_ends_with_the_robot():
    robot = with_cone("rays", clock=WallClock())
    assert robot._eye is not None
    assert robot._eye._camera is not None  # made already: that holds up this whole process
    end = time.monotonic() + 20.0
    while robot.read().frame is None and time.monotonic() < end:
        robot.wait(robot.now() + 0.05)
    frame = robot.read().frame
    assert frame is not None
    assert orange(frame.pixels).any()
    assert frame.stamp <= robot.now()
    robot.close()


def test_a_large_picture_by_rays_repeats_its_pixels():
    robot = Twin(sally(), camera="none")
    picture = robot.picture(641, 480, "behind", "rays")
    assert picture.shape == (480, 641, 3)
    assert np.array_equal(picture[0::3, 0::3][:160, :213], picture[1::3, 1::3][:160, :213])


def test_a_picture_from_above_shows_the_robot_where_it_is():
    robot = Twin(sally(), obstacles=scene(walls=[[-4, -2, 8, -2], [-4, 2, 8, 2]]), camera="none")
    before = robot.picture(200, 100, "above", "rays")
    drive(robot, Twist(1.0, 0.0), 3.0)
    after = robot.picture(200, 100, "above", "rays")

    def green(pixels: np.ndarray) -> float:
        r, g = pixels[..., 0].astype(int), pixels[..., 1].astype(int)
        return float(np.nonzero(g > 2 * r)[1].mean())

    assert green(after) > green(before) + 10
