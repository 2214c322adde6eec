"""Readers of Gazebo, BARN, map_server and pedestrian files."""

import gzip
import io
import json
import math
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose
from cohelm.law.reference import through
from cohelm.robot.sensors import LidarModel
from cohelm.scenario.worlds.barn import read_barn, read_collection, read_path, score
from cohelm.scenario.worlds.gazebo import read_gazebo
from cohelm.scenario.worlds.maps import FREE, OCCUPIED, UNKNOWN, read_map
from cohelm.scenario.worlds.tracks import ELSEWHERE, bodies, read_tracks
from cohelm.sim.lidar import scan
from cohelm.sim.world import place, world
from tests.few import first

DATA = Path(__file__).parents[3] / "shared" / "data"


def shared(name):
    if not (DATA / name).exists():
        pytest.skip(f"the shared data ({name}) are not beside this checkout")
    return DATA / name


# Gazebo worlds


def sdf(*models, state=""):
    return f"<sdf version='1.6'><world name='w'>{''.join(models)}{state}</world></sdf>"


def model(geometry, name="m", pose="0 0 0 0 0 0", link="0 0 0 0 0 0", collision="0 0 0.5 0 0 0"):
    return (
        f"<model name='{name}'><pose>{pose}</pose><link name='l'><pose>{link}</pose>"
        f"<collision name='c'><pose>{collision}</pose><geometry>{geometry}</geometry></collision>"
        f"<visual name='v'><geometry><sphere><radius>9</radius></sphere></geometry></visual>"
        f"</link></model>"
    )


def cylinder(radius=0.5, length=1.0):
    return f"<cylinder><radius>{radius}</radius><length>{length}</length></cylinder>"


def box(x, y, z=1.0):
    return f"<box><size>{x} {y} {z}</size></box>"


@pytest.fixture
def gazebo(tmp_path):
    def read(text, **options):
        path = tmp_path / "a.world"
        path.write_text(text)
        return read_gazebo(path, 0.3, **options)

    return read


def corners(walls):
    assert (walls[:, 2:] == np.roll(walls[:, :2], -1, axis=0)).all(), "the outline is closed"
    return sorted(tuple(np.round(corner, 9) + 0.0) for corner in walls[:, :2])


def test_poses_of_model_link_and_collision_are_combined(gazebo):
    seen = gazebo(sdf(model(
        cylinder(0.5), pose=f"1 2 0 0 0 {math.pi / 2}", link=f"1 0 0 0 0 {math.pi / 2}",
        collision="0.5 0 0.5 0 0 1",
    )))  # fmt: skip
    np.testing.assert_allclose(seen.discs, [[0.5, 3.0, 0.0, 0.0, 0.5, 0.8]], atol=1e-12)
    assert seen.names == ("m/l/c",)
    assert len(seen.walls) == 0
    assert seen.left_out == ()


def test_a_box_is_rotated_by_all_yaw_angles(gazebo):
    seen = gazebo(
        sdf(model(box(2, 4), pose="10 0 0 0 0 0.3", link=f"0 0 0 0 0 {math.pi / 2 - 0.3}"))
    )
    assert corners(seen.walls) == [(8.0, -1.0), (8.0, 1.0), (12.0, -1.0), (12.0, 1.0)]


def test_a_tilted_box_casts_its_shadow(gazebo):
    seen = gazebo(sdf(model(box(1, 2, 1), collision=f"0 0 0.5 0 {math.pi / 4} 0")))
    half = math.sqrt(2) / 2
    expected = [(-half, -1), (-half, 1), (half, -1), (half, 1)]
    np.testing.assert_allclose(corners(seen.walls), expected, atol=1e-8)


def test_a_lying_cylinder_is_covered(gazebo):
    seen = gazebo(sdf(model(cylinder(0.5, 4.0), collision=f"0 0 0.5 0 {math.pi / 2} 0")))
    assert corners(seen.walls) == [(-2.0, -0.5), (-2.0, 0.5), (2.0, -0.5), (2.0, 0.5)]


@pytest.mark.parametrize(
    ("height", "found"), [(0.5, 1), (-0.6, 0), (2.4, 1), (2.6, 0), (-0.49, 0), (-0.4, 1)]
)
def test_only_obstacles_at_the_height_of_the_robot_count(gazebo, height, found):
    round_ = model(cylinder(), collision=f"0 0 {height} 0 0 0")
    square = model(box(1, 1), collision=f"0 0 {height} 0 0 0")
    seen = gazebo(sdf(round_, square))
    assert (len(seen.discs), len(seen.walls)) == (found, 4 * found)


def test_spheres_and_capsules_are_discs(gazebo):
    capsule = "<capsule><radius>0.2</radius><length>1</length></capsule>"
    ball = "<sphere><radius>0.7</radius></sphere>"
    assert gazebo(sdf(model(capsule), model(ball))).discs[:, 4] == pytest.approx([0.2, 0.7])


def test_the_saved_state_moves_a_model_as_gazebo_does(gazebo):
    state = (
        "<state world_name='w'><model name='moved'><pose frame=''>5 6 0 0 0 0</pose></model>"
        "<model name='part'><link name='l'><pose>7 8 0 0 0 0</pose></link></model></state>"
    )
    seen = gazebo(sdf(
        model(cylinder(), "moved", "1 1 0 0 0 0"), model(cylinder(), "part", "1 1 0 0 0 0"),
        state=state,
    ))  # fmt: skip
    np.testing.assert_allclose(seen.discs[:, :2], [[5, 6], [7, 8]])


def test_nested_models_degrees_and_quaternions_are_understood(gazebo):
    inner = model(cylinder(), "inner", "1 0 0 0 0 0")
    half = math.sqrt(0.5)
    seen = gazebo(sdf(
        f"<model name='a'><pose degrees='true'>0 0 0 0 0 90</pose>{inner}</model>",
        f"<model name='b'><pose rotation_format='quat_xyzw'>0 5 0 0 0 {half} {half}</pose>{inner}"
        "</model>",
    ))  # fmt: skip
    np.testing.assert_allclose(seen.discs[:, :2], [[0, 1], [0, 6]], atol=1e-12)
    assert seen.names == ("a/inner/l/c", "b/inner/l/c")


def test_unreadable_parts_are_listed_except_the_ground(gazebo):
    plane = model("<plane><normal>0 0 1</normal><size>9 9</size></plane>")
    seen = gazebo(sdf(
        plane,
        "<include><uri>model://ground_plane</uri></include><include><uri>model://sun</uri></include>",
        "<include><uri>model://kitchen_dining</uri></include>",
        model("<mesh><uri>model://sofa.dae</uri></mesh>", "sofa"),
        "<model name='hung'><pose relative_to='door'>1 0 0 0 0 0</pose></model>",
        "<actor name='anna'/>",
    ))  # fmt: skip
    assert len(seen.discs) == len(seen.walls) == 0
    kitchen, sofa, hung, anna = seen.left_out
    assert "kitchen_dining" in kitchen
    assert "sofa/l/c" in sofa
    assert "mesh" in sofa
    assert "hung" in hung
    assert "door" in hung
    assert "anna" in anna


def test_a_model_file_without_a_world_is_read(gazebo):
    assert len(gazebo(f"<sdf version='1.7'>{model(cylinder())}</sdf>").discs) == 1


BOMB = (
    "<!DOCTYPE b [<!ENTITY a 'aaaaaaaaaa'><!ENTITY c '&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;'>]>"
    "<sdf version='1.6'><world name='w'>&c;</world></sdf>"
)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (BOMB, "entities or a DTD"),
        (sdf()[:-8], "not well-formed"),
        ("", "not well-formed"),
        ("<?xml version='1.0' encoding='utf-99'?><sdf/>", "not well-formed"),
        ("<robot name='r'/>", "is <robot>, not <sdf>"),
        ("<sdf version='1.6'/>", "neither a <world> nor a <model>"),
        (sdf(model(cylinder(), pose="1 2 nan 0 0 0")), "pose of m must be finite numbers"),
        (sdf(model(cylinder(), pose="1 2 3")), "pose of m needs x y z roll pitch yaw"),
        (sdf(model(cylinder(), pose="1e300 2 0 0 0 0")), "pose of m must be .* metres"),
        (sdf(model(cylinder(radius="wide"))), "radius of the cylinder m/l/c"),
        (sdf(model(cylinder(radius=-1))), "radius of the cylinder m/l/c must be 1 positive"),
        (sdf(model("<cylinder><length>1</length></cylinder>")), "radius of the cylinder m/l/c"),
        (sdf(model("<box><size>1 1</size></box>")), "size of the box m/l/c must be 3 positive"),
        (sdf(model(box("1e-30", 1))), "m/l/c is too thin"),
        (sdf("<model name='m'>" * 40 + "</model>" * 40), "nested deeper"),
    ],
)
def test_a_bad_world_file_is_refused_with_the_reason(gazebo, text, words):
    with pytest.raises(CohelmError, match=words) as caught:
        gazebo(text)
    assert "a.world" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_compressed_world_is_the_same_world_and_a_cut_archive_is_refused(tmp_path):
    path = tmp_path / "a.world.gz"
    packed = gzip.compress(sdf(model(cylinder())).encode())
    path.write_bytes(packed)
    assert len(read_gazebo(path, 0.3).discs) == 1
    damaged = packed[:30] + bytes([packed[30] ^ 0xFF]) + packed[31:]
    for wrong in (packed[:-20], packed[:5], damaged):
        path.write_bytes(wrong)
        with pytest.raises(CohelmError, match="damaged or cut short"):
            read_gazebo(path, 0.3)


def test_a_decompression_bomb_is_refused(tmp_path):
    path = tmp_path / "a.world.gz"
    path.write_bytes(gzip.compress(bytes(65 * 2**20), 1))
    with pytest.raises(CohelmError, match="larger than 64 MB"):
        read_gazebo(path, 0.3)


@pytest.mark.parametrize("read", [lambda p: read_gazebo(p, 0.3), read_path, read_map, read_tracks])
def test_a_missing_file_or_a_folder_is_reported(tmp_path, read):
    with pytest.raises(CohelmError, match=r"nowhere\.x: there is no such file"):
        read(tmp_path / "nowhere.x")
    with pytest.raises(CohelmError, match="can not be read"):
        read(tmp_path)


# BARN


def test_path_cells_are_converted_to_metres(tmp_path):
    np.save(tmp_path / "path_3.npy", np.array([[26, 0], [0, 1]]))
    points = read_path(tmp_path / "path_3.npy")
    np.testing.assert_allclose(points, [[-0.675, 5.075], [-4.575, 5.225]], atol=1e-12)


@pytest.mark.parametrize(
    ("array", "words"),
    [
        (np.zeros((3, 3)), r"shape \(m, 2\)"), (np.zeros((0, 2)), r"shape \(m, 2\)"),
        (np.zeros(4), r"shape \(m, 2\)"), (np.array([[0.0, math.nan]]), "finite"),
        (np.array([["a", "b"]]), "not numbers"), (np.array([[None, 1]]), "whole NumPy"),
    ],
)  # fmt: skip
def test_a_path_of_another_shape_or_type_is_refused(tmp_path, array, words):
    np.save(tmp_path / "p.npy", array, allow_pickle=True)
    with pytest.raises(CohelmError, match=words):
        read_path(tmp_path / "p.npy")


def test_a_truncated_or_oversized_path_is_refused(tmp_path):
    file = io.BytesIO()
    np.save(file, np.zeros((10, 2)))
    whole = file.getvalue()
    huge = whole.replace(b"(10, 2), }     ", b"(1000000, 2), }")
    assert len(huge) == len(whole)
    head = whole.replace(b"False", b"(((((")
    for wrong in (whole[:-8], whole[:7], b"", b"PK\x03\x04 no archive", huge, head):
        (tmp_path / "p.npy").write_bytes(wrong)
        with pytest.raises(CohelmError, match=r"p\.npy"):
            read_path(tmp_path / "p.npy")


@pytest.mark.parametrize("number", [0, 60, 150])
def test_the_challenges_own_files_and_their_collection_agree(number):
    raw = shared("barn/raw")
    collection = read_collection(shared("barn/worlds.json"), 0.27)
    one = read_barn(raw / f"world_{number}.world.gz", raw / f"path_{number}.npy", 0.27, number)
    same = collection[number]
    np.testing.assert_allclose(one.discs, same.discs, atol=1e-6)
    np.testing.assert_allclose(one.path, same.path, atol=1e-6)
    assert len(one.walls) == 0
    assert one.left_out == ()
    assert (one.start, one.goal) == (same.start, same.goal)
    assert (one.near_goal, one.time_limit) == (same.near_goal, same.time_limit) == (1.0, 100.0)


def test_every_world_has_the_optimal_time_its_makers_state_and_a_route_to_drive():
    path = shared("barn/worlds.json")
    stated = {w["id"]: w["opt_time"] for w in json.loads(path.read_text())["worlds"]}
    worlds = read_collection(path, 0.27)
    assert len(worlds) == len(stated) == 50
    for number, barn in worlds.items():
        assert barn.optimal_time == pytest.approx(stated[number], abs=1e-4)
        route = through(barn.route, 1.0)
        assert route.duration == pytest.approx(2.0 * stated[number], abs=1e-3)
        clearances = np.hypot(*(barn.route[:, None] - barn.discs[:, :2]).transpose(2, 0, 1))
        assert clearances.min() > 0.075, "the reference path keeps off the cylinders"


def test_a_collection_is_read_and_defaults_to_the_challenges_limits(tmp_path):
    path = tmp_path / "w.json"
    path.write_text('{"worlds": [{"id": 4, "cyl": [[1, 2]], "path": [[-2.25, 5], [-2.25, 9]]}]}')
    barn = read_collection(path, 0.25)[4]
    np.testing.assert_allclose(barn.discs, [[1, 2, 0, 0, 0.075, 0.325]])
    np.testing.assert_allclose(barn.route, [[-2.25, 3], [-2.25, 5], [-2.25, 9], [-2.25, 13]])
    assert barn.optimal_time == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('{"worlds": [', "JSON"),
        ("[]", "the file"),
        ('{"world": []}', "worlds is missing"),
        ('{"worlds": [{"id": 1, "cyl": [[1]], "path": [[1, 2]]}]}', "worlds.0.cyl.0"),
        ('{"worlds": [{"id": 1, "cyl": [[1, NaN]], "path": [[1, 2]]}]}', "finite"),
        ('{"worlds": [{"id": 1, "cyl": [[1, 1e300]], "path": [[1, 2]]}]}', "worlds.0.cyl.0.1"),
        ('{"worlds": [{"id": 1, "cyl": [], "path": []}]}', "worlds.0.path"),
        (
            '{"worlds": [{"id": 1, "cyl": [], "path": [[1, 2]]},'
            '{"id": 1, "cyl": [], "path": [[1, 2]]}]}',
            "world 1 is there twice",
        ),
    ],
)
def test_a_bad_collection_is_refused_with_the_key(tmp_path, text, words):
    (tmp_path / "w.json").write_text(text)
    with pytest.raises(CohelmError, match=words):
        read_collection(tmp_path / "w.json", 0.25)


@pytest.mark.parametrize(
    ("time", "arrived", "expected"),
    [(5.0, True, 0.5), (10.0, True, 0.5), (20.0, True, 0.25), (90.0, True, 0.125),
     (5.0, False, 0.0), (math.nan, True, 0.0)],
)  # fmt: skip
def test_the_score_is_that_of_the_challenge_since_2026(time, arrived, expected):
    assert score(5.0, time, arrived) == pytest.approx(expected)


# map_server maps

SHADES = np.array([[0, 100, 205], [254, 255, 60]], dtype=np.uint8)


def write_map(folder, pixels=SHADES, name="m.pgm", plain=False, **keys):
    image = Image.fromarray(pixels)
    if plain:
        rows, columns = pixels.shape
        lines = [f"P2\n# by hand\n{columns} {rows}\n255", *(" ".join(map(str, r)) for r in pixels)]
        (folder / name).write_text("\n".join(lines))
    else:
        image.save(folder / name)
    about = {
        "image": name, "resolution": 0.5, "origin": [1.0, 2.0, 0.0], "negate": 0,
        "occupied_thresh": 0.65, "free_thresh": 0.196,
    } | keys  # fmt: skip
    path = folder / "m.yaml"
    path.write_text(json.dumps(about))  # YAML is a superset of JSON
    return path


@pytest.mark.parametrize(("name", "plain"), [("m.pgm", False), ("m.pgm", True), ("m.png", False)])
def test_dark_is_occupied_bright_is_free_and_the_first_row_is_on_top(tmp_path, name, plain):
    found = read_map(write_map(tmp_path, name=name, plain=plain))
    expected = [[FREE, FREE, OCCUPIED], [OCCUPIED, UNKNOWN, UNKNOWN]]
    np.testing.assert_array_equal(found.cells, expected)
    assert (found.resolution, found.origin) == (0.5, Pose(1.0, 2.0, 0.0))


@pytest.mark.parametrize("comment", [b"", b"# by GIMP\r\n"])
def test_an_image_whose_header_has_the_line_ends_of_windows_is_read_from_its_first_pixel(
    tmp_path, comment
):
    path = write_map(tmp_path)
    (tmp_path / "m.pgm").write_bytes(b"P5\r\n" + comment + b"3 2\r\n255\r\n" + SHADES.tobytes())
    expected = [[FREE, FREE, OCCUPIED], [OCCUPIED, UNKNOWN, UNKNOWN]]
    np.testing.assert_array_equal(read_map(path).cells, expected)


def test_a_pixel_that_looks_like_a_line_end_is_one(tmp_path):
    path = write_map(tmp_path)
    (tmp_path / "m.pgm").write_bytes(b"P5 1 2 255\r\n\xff")
    np.testing.assert_array_equal(read_map(path).cells, [[FREE], [OCCUPIED]])


def test_negate_turns_dark_and_bright_around(tmp_path):
    found = read_map(write_map(tmp_path, negate=1))
    np.testing.assert_array_equal(
        found.cells, [[OCCUPIED, OCCUPIED, UNKNOWN], [FREE, UNKNOWN, OCCUPIED]]
    )


def test_scale_and_raw_maps_keep_intermediate_values(tmp_path):
    scaled = read_map(write_map(tmp_path, mode="scale")).cells
    assert scaled[1, 1] == round(100 * (155 / 255 - 0.196) / (0.65 - 0.196))
    assert scaled[1, 0] == OCCUPIED
    raw = read_map(write_map(tmp_path, mode="raw")).cells
    np.testing.assert_array_equal(raw, [[UNKNOWN, UNKNOWN, 60], [0, 100, UNKNOWN]])


def test_a_transparent_pixel_of_a_scale_map_is_unknown(tmp_path):
    pixels = np.zeros((1, 2, 4), dtype=np.uint8)
    pixels[0, 1, 3] = 255
    found = read_map(write_map(tmp_path, pixels, "m.png", mode="scale"))
    np.testing.assert_array_equal(found.cells, [[UNKNOWN, OCCUPIED]])


def test_the_colours_of_a_palette_image_are_used(tmp_path):
    path = write_map(tmp_path, name="m.png")
    Image.fromarray(SHADES).convert("P").save(tmp_path / "m.png")
    assert read_map(path).cells[1, 0] == OCCUPIED


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: " + "[" * 5000, r"m\.yaml: is nested too deeply: give a map_server"),
        ("image: m.pgm\n\tresolution: 0.05\n", r"m\.yaml:2: has a tab, and YAML is indented with"),
        ("image: m.pgm\norigin:\n\t- 1\n", r"m\.yaml:3: has a tab, and YAML is indented with"),
    ],
)
def test_a_tab_or_deep_nesting_in_a_map_description_is_named(tmp_path, text, said):
    (tmp_path / "m.yaml").write_text(text)
    with pytest.raises(CohelmError, match=said):
        read_map(tmp_path / "m.yaml")


def test_unknown_cells_are_solid_only_on_request(tmp_path):
    found = read_map(write_map(tmp_path))
    np.testing.assert_array_equal(found.grid().free == 0, found.cells == OCCUPIED)
    np.testing.assert_array_equal(found.grid(unknown_is_solid=True).free == 0, found.cells != FREE)


def test_the_origin_of_a_map_includes_its_yaw(tmp_path):
    pixels = np.full((4, 4), 255, dtype=np.uint8)
    pixels[:, 3] = 0  # the right column, x from 1.5 to 2 in the map
    path = write_map(tmp_path, pixels, origin=[10.0, 20.0, math.pi / 2])
    ranges = np.empty(1)
    lidar = LidarModel(beams=1).lidar()
    at = Pose(9.0, 20.0, math.pi / 2)  # the map's x axis points to world +y
    scan(at, lidar, np.empty((0, 6)), np.empty((0, 4)), read_map(path).grid(), 0, 0, ranges)
    assert ranges[0] == pytest.approx(1.5)


def png_header(width, height):
    def chunk(kind, data):
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", zlib.compress(b"")) + chunk(b"IEND", b"")


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (b"P5 30000 30000 255\n", "more cells than the 64000000"),
        (b"P5 9000 9000 255\n", "more than 64000000"),
        (png_header(9000, 9900), "more than 64000000"),
        (b"P5 20 20 255\n123", "not a whole PGM or PNG"),
        (png_header(20, 20), "not a whole PGM or PNG"),
        (b"P2 2 2 255\n1 2 x 4", "not a whole PGM or PNG"),
        (b"GIF? no", "not a whole PGM or PNG"),
        (b"", "not a whole PGM or PNG"),
        (b"P5 2 1 65535\n1234", "more than 8 bits"),
    ],
)
def test_a_bad_image_is_refused_with_the_reason(tmp_path, image, words):
    path = write_map(tmp_path)
    (tmp_path / "m.pgm").write_bytes(image)
    with pytest.raises(CohelmError, match=words) as caught:
        read_map(path)
    assert "m.pgm" in str(caught.value)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"resolution": 0.0}, "m.yaml: resolution must be greater than 0, not 0.0$"),
        ({"resolution": None}, "m.yaml: resolution must be a valid number, not None$"),
        ({"cohelm_frame": "moon"}, "m.yaml: cohelm_frame must be 'map' or 'start', not 'moon'$"),
        ({"resolution": math.nan}, "resolution"),
        (
            {"resolution": 1e300},
            r"m\.yaml: resolution is the side of a cell in metres, got 1e\+300, and one of",
        ),
        ({"resolution": 50}, "got 50, and one of more than 1 m .* millimetres by 1000$"),
        ({"resolution": 5.0}, "got 5, and one of more than 1 m .*: divide centimetres by 100"),
        ({"resolution": 1e-320}, "m.yaml: resolution is the side of a cell in metres"),
        (
            {"origin": [0.0, 1e300, 0.0]},
            r"m\.yaml: origin is x and y in metres and a yaw in radians",
        ),
        (
            {"origin": [0.0, 0.0, 45.0]},
            r"m\.yaml: origin is x and y .* in radians, got \[.*45.*\]$",
        ),
        ({"origin": [0.0]}, "origin"),
        ({"origin": [0.0, "west", 0.0]}, r"origin\.1"),
        ({"free_thresh": 0.7}, "m.yaml: free_thresh must be smaller than occupied_thresh$"),
        ({"mode": "colour"}, "mode"),
        ({"image": "gone.pgm"}, r"gone\.pgm: there is no such image, but .*m\.yaml names it"),
        ({"image": ""}, "image"),
    ],
)
def test_a_bad_map_description_is_refused_with_the_key(tmp_path, keys, words):
    path = write_map(tmp_path, **keys)
    path.write_text(path.read_text().replace("NaN", ".nan"))
    with pytest.raises(CohelmError, match=words):
        read_map(path)


@pytest.mark.parametrize(
    "text", first(["", "- 1", "image: [", "\x00", "a: &a [*a]", "[" * 5000], 5)
)
def test_a_description_that_is_no_map_is_refused(tmp_path, text):
    (tmp_path / "m.yaml").write_text(text)
    with pytest.raises(CohelmError, match=r"m\.yaml"):
        read_map(tmp_path / "m.yaml")


@pytest.mark.parametrize("name", ["turtlebot3_world", "uob_vfh_training_arena"])
def test_a_real_map_is_read_by_its_thresholds(tmp_path, name):
    about = json.loads(shared("maps/maps.json").read_text())[name]
    (tmp_path / "m.yaml").write_text(
        f"image: {DATA / 'maps' / about['png']}\nresolution: {about['resolution']}\n"
        f"origin: [{about['origin_xy'][0]}, {about['origin_xy'][1]}, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    found = read_map(tmp_path / "m.yaml")
    assert found.cells.shape == tuple(about["shape_hw"])
    area = (found.cells == FREE).sum() * found.resolution**2
    assert area == pytest.approx(about["free_m2"], abs=0.1)
    with Image.open(DATA / "maps" / about["png"]) as image:
        pixels = np.flipud(np.asarray(image.convert("L")))
    for value, shade in ((FREE, 255), (OCCUPIED, 0), (UNKNOWN, 127)):
        np.testing.assert_array_equal(found.cells == value, pixels == shade)


# pedestrian tracks

WALK = "t,id,x,y\n10.0,anna,0,0\n10.4,anna,0.4,0\n11.2,anna,0.4,0.8\n10.0,bo,5,5\n"


@pytest.fixture
def tracks(tmp_path):
    def read(text):
        path = tmp_path / "p.csv"
        path.write_bytes(text.encode() if isinstance(text, str) else text)
        return read_tracks(path)

    return read


def test_people_are_read_in_any_order_of_rows_and_columns(tracks):
    anna, bo = tracks(WALK)
    shuffled = "\ufeffy, id ,x,t,extra\n0.8,anna,0.4,11.2,1\n0,anna,0,10,1\n0,anna,0.4,10.4,1\n"
    (again,) = tracks(shuffled)
    np.testing.assert_array_equal(again.times, anna.times)
    np.testing.assert_array_equal(again.points, anna.points)
    assert (anna.name, bo.name) == ("anna", "bo")


def where(track, t, begin=0.0):
    """The disc of a track at time t of the simulator."""
    _, made = bodies([track], 0.25, 0.35, begin, 100.0)
    discs = np.empty((1, 6))
    place(discs, world((made, np.empty((0, 4)))), t)
    return discs[0]


@pytest.mark.parametrize("begin", [0.0, 9.0, 10.6])
def test_a_person_walks_straight_from_sample_to_sample(tracks, begin):
    anna = tracks(WALK)[0]
    for t, expected in (
        (10.0, (0.0, 0.0, 1.0, 0.0)), (10.3, (0.3, 0.0, 1.0, 0.0)),
        (10.4, (0.4, 0.0, 0.0, 1.0)), (11.0, (0.4, 0.6, 0.0, 1.0)),
    ):  # fmt: skip
        if t >= begin:
            found = where(anna, t - begin, begin)
            np.testing.assert_allclose(found, (*expected, 0.25, 0.6), atol=1e-9)


@pytest.mark.parametrize("t", [0.0, 5.0, 9.5, 9.999, 11.201, 12.0, 12.3, 80.0])
def test_outside_its_samples_a_person_is_far_away(tracks, t):
    found = where(tracks(WALK)[0], t)
    np.testing.assert_array_equal(found[:4], (ELSEWHERE, ELSEWHERE, 0.0, 0.0))


def test_only_persons_present_during_the_run_become_bodies(tracks):
    people = tracks(WALK + "50,carl,0,0\n51,carl,1,0\n")
    assert bodies(people, 0.25, 0.3, 0.0, 20.0)[0] == ("anna",)
    assert bodies(people, 0.25, 0.3, 11.0, 45.0)[0] == ("anna", "carl")
    assert bodies(people, 0.25, 0.3, 12.0, 20.0) == ((), [])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no column t, id, x, y"),
        ("t,id,x\n0,1,2\n", "no column y"),
        ("t,id,x,y\n0,1,2,3\n1,1,nan,3\n", "line 3: x must be a finite number, got 'nan'"),
        ("t,id,x,y\n0,1,2\n", "line 2: y must be a finite number, got None"),
        ("t,id,x,y\nnow,1,2,3\n", "line 2: t must be a finite number, got 'now'"),
        ("t,id,x,y\n0,,2,3\n", "line 2: id is empty"),
        ("t,id,x,y\n0,1,2,3\n0,1,2,4\n", "person 1 is there twice at t = 0 s"),
        ("t,id,x,y\n0,1,2,3\n1e-320,1,2,4\n", "person 1 is there twice at t = 0 s"),
        ("t,id,x,y\n1e300,1,2,3\n", "line 2: t must be"),
        ("t,id,x,y\n0,1,-1e300,3\n", "line 2: x must be"),
        (b"t,id,x,y\n\xff\xfe,1,2,3\n", "not a CSV text file"),
        ('t,id,x,y\n0,"1,2,3\n', "not a CSV text file"),
    ],
)
def test_bad_tracks_are_refused_with_the_line(tracks, text, words):
    with pytest.raises(CohelmError, match=words) as caught:
        tracks(text)
    assert "p.csv" in str(caught.value)


@pytest.mark.parametrize(("name", "people", "at_once"), [("eth", 360, 27), ("hotel", 390, 18)])
def test_recorded_crowds_pass_through_their_samples(name, people, at_once):
    crowd = read_tracks(shared(f"crowd/{name}.csv"))
    assert len(crowd) == people
    times, count = np.unique(np.concatenate([track.times for track in crowd]), return_counts=True)
    assert count.max() == at_once
    busiest = float(times[count.argmax()])
    names, made = bodies(crowd, 0.25, 0.35, busiest - 20.0, 40.0)
    discs = np.empty((len(made), 6))
    place(discs, world((made, np.empty((0, 4)))), 20.2)  # half-way to the next sample
    expected = {
        track.name: [np.interp(busiest + 0.2, track.times, axis) for axis in track.points.T]
        for track in crowd
        if track.times[0] < busiest + 0.2 < track.times[-1]
    }
    assert len(expected) > 0.8 * at_once
    present = {n: row[:2] for n, row in zip(names, discs, strict=True) if row[0] < ELSEWHERE}
    assert present.keys() == expected.keys()
    for who, point in present.items():
        np.testing.assert_allclose(point, expected[who], atol=1e-6)


def test_a_maps_picture_in_place_of_its_yaml_is_told_so(tmp_path):
    write_map(tmp_path)
    [picture] = [file for file in tmp_path.iterdir() if file.suffix == ".pgm"]
    picture.write_bytes(b"P5 2 2 255\n\xff\xfe\x00\x00")
    with pytest.raises(CohelmError, match="is a picture: give the YAML file that goes with it"):
        read_map(picture)


def test_a_map_with_umlauts_in_another_encoding_is_told_apart_from_what_is_no_yaml(tmp_path):
    path = write_map(tmp_path)
    path.write_bytes(b"# B\xfcro\n" + path.read_bytes())
    with pytest.raises(CohelmError, match=r"m\.yaml: is not text in UTF-8"):
        read_map(path)
