"""Gazebo worlds with animated models, as DynaBARN's."""

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.scenario.world import GazeboWorld, read
from cohelm.scenario.worlds.gazebo import read_gazebo
from cohelm.sim.world import place, world

FRAMES = [(0.0, -4.0, 2.0), (2.0, 0.0, 2.0), (5.0, 0.0, -1.0)]


def cc(frames=FRAMES, length=5.0, repeat="true"):
    keys = "".join(
        f"\n  key = anim->CreateKeyFrame({t:.2f});"
        f"\n  key->Translation(ignition::math::Vector3d({x:.2f}, {y:.2f}, 0));"
        "\n  key->Rotation(ignition::math::Quaterniond(0, 0, 0));"
        for t, x, y in frames
    )
    return (
        f"gazebo::common::PoseAnimationPtr anim(\n // make it last 10 seconds, CreateKeyFrame(9)\n"
        f' new gazebo::common::PoseAnimation("obs_7", {length:.2f}, {repeat}));{keys}\n'
        "/* key = anim->CreateKeyFrame(7.0); key->Translation(Vector3d(9, 9, 0)); */\n"
        "_parent->SetAnimation(anim);"
    )


def moving(shape="<cylinder><radius>0.5</radius><length> 1 </length></cylinder>", off="0 0 0"):
    """As DynaBARN writes them, walls that are no XML and a stray backslash among it."""
    return f"""<?xml version="1.0" ?>
<sdf version="1.6"><world name="default">
<model name='obs_7'><static>1</static>
 <pose frame=''>-0.225000 0.075000 0.000000 0.000000 0.000000 0.000000</pose>
 <link name='link'><pose>{off} 0 0 0</pose><collision name='collision'><geometry>{shape}</geometry>
 </collision></link><plugin name='obs_7' filename='libobs_7.so'/></model>
<model name="back_wall"><static>1</static>\\   <pose frame=>-10 0 .5 0 0 0</pose>
 <link name="box_link"><collision name='collision'><geometry><box><size>.5 20 1</size></box>
 </geometry></collision></link></model>
</world></sdf>"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "worlds").mkdir()
    (tmp_path / "plugins").mkdir()
    (tmp_path / "worlds" / "world_3.world").write_text(moving())
    return tmp_path


def seen(folder, source, duration=20.0, text=None):
    (folder / "plugins" / "obs_7.cc").write_text(source)
    path = folder / "worlds" / "world_3.world"
    if text is not None:
        path.write_text(text)
    return read(GazeboWorld(kind="gazebo", file=str(path)), 0.3, duration)


def at(made, t):
    scene = world((made.bodies, made.walls))
    discs = np.empty((len(scene.discs), 6))
    place(discs, scene, t)
    return discs[0]


def test_a_cylinder_moves_straight_between_key_frames_and_repeats(folder):
    made = seen(folder, cc())
    assert len(made.bodies) == 1
    assert len(made.walls) == 4
    assert not made.left_out
    for t, x, y, vx, vy in [
        (0.0, -4.0, 2.0, 2.0, 0.0), (1.0, -2.0, 2.0, 2.0, 0.0), (3.5, 0.0, 0.5, 0.0, -1.0),
        (6.0, -2.0, 2.0, 2.0, 0.0), (19.9, 0.0, -0.9, 0.0, -1.0),
    ]:  # fmt: skip
        assert at(made, t)[:4] == pytest.approx([x, y, vx, vy], abs=1e-9), t
    assert at(made, 0.0)[4:] == pytest.approx([0.5, 0.8])


def test_the_jump_at_the_end_of_a_period_is_no_motion(folder):
    made = seen(folder, cc())
    speeds = [np.hypot(*at(made, t)[2:4]) for t in np.linspace(0.0, 20.0, 2001)]
    assert max(speeds) <= 2.0 + 1e-9


def test_an_animation_without_repeat_stays_at_its_end(folder):
    made = seen(folder, cc(repeat="false"))
    for t in (5.5, 20.0):
        assert at(made, t)[:4] == pytest.approx([0.0, -1.0, 0.0, 0.0])


def test_the_last_key_frame_is_held_until_the_end_of_the_period(folder):
    made = seen(folder, cc(length=8.0))
    assert at(made, 7.0)[:4] == pytest.approx([0.0, -1.0, 0.0, 0.0])
    assert at(made, 9.0)[:4] == pytest.approx([-2.0, 2.0, 2.0, 0.0])


def test_parts_move_with_their_model_and_a_box_becomes_a_disc(folder):
    made = seen(folder, cc(), text=moving("<box><size>0.6 0.8 1</size></box>", off="1 -2 0"))
    assert at(made, 1.0)[:4] == pytest.approx([-1.0, 0.0, 2.0, 0.0])
    assert at(made, 0.0)[4] == pytest.approx(0.5)


def test_a_plugin_without_source_is_reported_and_its_model_stands(folder):
    seen = read_gazebo(folder / "worlds" / "world_3.world", 0.3)
    assert seen.animations == (None,)
    assert seen.discs[0, :2] == pytest.approx([-0.225, 0.075])
    assert ["obs_7: what libobs_7.so does is not known" in one for one in seen.left_out] == [True]


@pytest.mark.parametrize(
    ("source", "says"),
    [("int main() {}", "no PoseAnimation with key frames"),
     (cc([(0.0, 1.0, 1.0), (0.0, 2.0, 2.0)]), "times of key frames must grow"),
     (cc().replace("-4.00", "1e999"), "finite numbers"),
     (cc().replace("(0.00)", "(-1e300)", 1), "finite numbers"),
     (cc([(0.0, 1.0, 1.0), (1.0, 2.0, 2.0)], 0.0).replace("(1.00)", "(1e-310)"), "must grow"),
     (cc().replace("key->Translation", "key->Moved", 1), "no PoseAnimation with key frames"),
     (cc().replace("(2.00)", "(t)"), "no PoseAnimation with key frames"),
     (cc([(0.0, 1.0, 1.0), (1e-5, 2.0, 2.0)], length=0.0).replace("(0.00)", "(0)", 1)
      .replace("CreateKeyFrame(0.00)", "CreateKeyFrame(1e-5)"), "at most 100000 pieces")],
)  # fmt: skip
def test_an_invalid_animation_source_is_refused_in_one_sentence(folder, source, says):
    with pytest.raises(CohelmError, match=says):
        seen(folder, source, duration=1e4)
