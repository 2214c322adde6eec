"""CARMEN logs, damaged lines included."""

import gzip
import math
from pathlib import Path

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.scenario.worlds.carmen import read_log

INTEL = Path(__file__).parents[2].parent / "shared" / "data" / "lidar" / "intel.gfs.log"


def flaser(t, n=180, pose=(1.0, 2.0, 0.5), laser=None, ranges=None):
    ranges = [3.0] * n if ranges is None else ranges
    front = pose if laser is None else laser
    numbers = " ".join(map(str, [*ranges, *front, *pose]))
    return f"FLASER {n} {numbers} {t} host {t}"


def written(tmp_path, *lines):
    path = tmp_path / "a.log"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_scans_and_odometry_of_a_log(tmp_path):
    made = read_log(
        written(
            tmp_path, "# message_name ...", "PARAM robot_length 0.5 1 host 1",
            "ODOM 0 0 0 0 0 0 0.5 host 0.5", flaser(1.0), flaser(2.0, pose=(1.5, 2.0, 0.6)),
        )
    )  # fmt: skip
    assert [s.stamp for s in made.scans] == [1.0, 2.0]
    assert [o.stamp for o in made.odometry] == [0.5, 1.0, 2.0]
    assert made.odometry[2].pose == (1.5, 2.0, 0.6)
    assert made.scans[1].number == 1
    assert made.lidar.beams == 180


def test_the_pose_of_a_scan_is_that_of_its_own_line(tmp_path):
    """A scan matcher's log says first where odometry led, and then, in the scan, where it is."""
    before = "ODOM 1.4 2.1 0.5 0 0 0 2.0 host 2.0"
    made = read_log(written(tmp_path, flaser(1.0), before, flaser(2.0, pose=(1.5, 2.0, 0.6))))
    assert [o.pose for o in made.odometry] == [(1.0, 2.0, 0.5), (1.5, 2.0, 0.6)]


@pytest.mark.parametrize(
    ("n", "step", "last"), [(180, 1.0, 89.0), (181, 1.0, 90.0), (361, 0.5, 90.0)]
)
def test_the_beams_of_a_front_laser_go_from_right_to_left(tmp_path, n, step, last):
    lidar = read_log(written(tmp_path, flaser(1.0, n))).lidar.lidar()
    bearings = np.degrees(lidar.mount.psi + lidar.first + lidar.step * np.arange(n))
    assert bearings[0] == pytest.approx(-90.0)
    assert bearings[-1] == pytest.approx(last)
    assert math.degrees(lidar.step) == pytest.approx(step)


def test_the_mount_of_the_laser_is_read(tmp_path):
    pose = (1.0, 2.0, math.pi / 2)
    lidar = read_log(written(tmp_path, flaser(1.0, pose=pose, laser=(1.0, 2.3, math.pi / 2)))).lidar
    assert (lidar.mount_x_m, lidar.mount_y_m) == pytest.approx((0.3, 0.0))


def test_ranges_beyond_the_scanner_are_no_returns(tmp_path):
    ranges = [81.83, 5.0, 0.0] + [2.0] * 177
    (scan,) = read_log(written(tmp_path, flaser(1.0, ranges=ranges))).scans
    assert scan.ranges[:4].tolist() == [math.inf, 5.0, math.inf, 2.0]


def test_the_newer_kind_of_message_describes_its_laser(tmp_path):
    line = (
        "ROBOTLASER1 0 -1.0 2.0 0.5 30 0.01 0 5 1 2 3 4 5 0 1.2 0 0 1 0 0 0 0 0.2 0.3 0 "
        "12.5 host 12.5"
    )
    made = read_log(written(tmp_path, line))
    lidar = made.lidar.lidar()
    assert lidar.mount.psi + lidar.first == pytest.approx(-1.0)
    assert lidar.step == pytest.approx(0.5)
    assert lidar.mount.x == pytest.approx(0.2)
    assert made.scans[0].ranges.tolist() == [1, 2, 3, 4, 5]
    assert made.odometry[0].pose == (1.0, 0.0, 0.0)


def test_a_raw_scan_gets_its_pose_from_the_odometry(tmp_path):
    raw = "RAWLASER1 0 -1.5 3.0 1.5 30 0.01 0 3 1 2 3 0 5.0 host 5.0"
    made = read_log(written(tmp_path, "ODOM 1 2 3 0 0 0 5.0 host 5.0", raw))
    assert len(made.scans) == 1
    assert made.odometry[0].pose == (1.0, 2.0, 3.0)


def test_damaged_lines_are_left_out_and_the_others_read(tmp_path):
    cut = flaser(2.0)[:200]
    made = read_log(
        written(
            tmp_path, flaser(1.0), cut, "FLASER many 1 2", "ODOM nan 0 0 0 0 0 2.5 h 2.5",
            flaser(3.0, n=90), "", "FLASER", flaser(4.0), flaser(3.5),
        )
    )  # fmt: skip
    assert [s.stamp for s in made.scans] == [1.0, 3.5, 4.0]
    assert made.left_out == (
        "lines damaged or cut short: 4, the first in line 2; "
        "scans with another number of beams than most: 1, the first in line 5"
    )
    assert all(np.isfinite(o.pose).all() for o in made.odometry)


def test_a_gzip_log_is_read_as_it_is(tmp_path):
    path = tmp_path / "a.log.gz"
    path.write_bytes(gzip.compress(flaser(1.0).encode()))
    assert len(read_log(path).scans) == 1


LINE = flaser(3.0)


@pytest.mark.parametrize("end", [2, 7, 200, len(LINE) - 6, len(LINE) - 9])
@pytest.mark.parametrize("pack", [bytes, gzip.compress])
def test_a_log_that_ends_in_the_middle_of_a_line_is_not_whole(tmp_path, end, pack):
    path = tmp_path / "a.log"
    path.write_bytes(pack("\n".join((flaser(1.0), flaser(2.0), LINE[:end])).encode()))
    made = read_log(path)
    assert not made.whole
    assert [s.stamp for s in made.scans[:2]] == [1.0, 2.0]


@pytest.mark.parametrize("end", ["\n", "", "\n# the end", "\n\n"])
def test_a_log_that_ends_after_a_line_is_whole(tmp_path, end):
    (tmp_path / "a.log").write_text(flaser(1.0) + "\n" + LINE + end)
    assert read_log(tmp_path / "a.log").whole


def test_of_a_cut_archive_what_there_is_of_it_is_read(tmp_path):
    random = np.random.default_rng(1)
    lines = [flaser(float(t), ranges=random.uniform(1.0, 9.0, 180)) for t in range(100)]
    packed = gzip.compress("\n".join(lines).encode())
    path = tmp_path / "a.log.gz"
    path.write_bytes(packed[: len(packed) // 2])
    made = read_log(path)
    assert not made.whole
    assert 40 < len(made.scans) < 60
    path.write_bytes(packed[:-4])
    made = read_log(path)
    assert (made.whole, len(made.scans)) == (False, 100)
    path.write_bytes(packed[:12])
    with pytest.raises(CohelmError, match="gzip archive is damaged or cut short"):
        read_log(path)


@pytest.mark.parametrize("hertz", [1, 10, 40])
@pytest.mark.parametrize(
    ("unit", "named"),
    [
        (1e3, "milliseconds by 1000"),
        (1e6, "microseconds by 1e6"),
        (1e9, "nanoseconds by 1e9"),
    ],
)
def test_times_in_another_unit_than_seconds_are_reported(tmp_path, hertz, unit, named):
    lines = [flaser(1.7e9 * unit + k * unit / hertz, pose=(0.1 * k, 0, 0)) for k in range(30)]
    with pytest.raises(CohelmError, match=f"times are in seconds, got .*: divide {named}"):
        read_log(written(tmp_path, *lines))


def test_scans_that_are_seldom_are_read(tmp_path):
    assert len(read_log(written(tmp_path, *[flaser(8.0 * k) for k in range(30)])).scans) == 30


@pytest.mark.parametrize("text", ["", "hello world\n", "ODOM 0 0 0 0 0 0 1 h 1\n"])
def test_a_file_without_scans_is_refused_in_a_sentence(tmp_path, text):
    path = tmp_path / "a.log"
    path.write_text(text)
    with pytest.raises(CohelmError, match="holds no scan of a CARMEN log"):
        read_log(path)


@pytest.mark.skipif(not INTEL.exists(), reason="the Intel log is not beside this checkout")
def test_the_intel_log_is_read_whole():
    made = read_log(INTEL)
    assert len(made.scans) == 910
    assert len(made.odometry) > 10_000
    assert made.left_out == ""
    assert made.lidar.beams == 180


def stamped(logged, sent, pose=(0.0, 0.0, 0.0)):
    return " ".join(flaser(0.0, pose=pose).split()[:-3]) + f" {sent} host {logged}"


@pytest.mark.parametrize(
    "garbage", [lambda k: 0.0, lambda k: k % 2, lambda k: math.nan, lambda k: (k * 7919) % 101]
)
def test_a_log_with_invalid_logger_times_is_read_by_its_sender_times(tmp_path, garbage):
    lines = [stamped(garbage(k), 5.0 + k, (0.1 * k, 0.0, 0.0)) for k in range(80)]
    made = read_log(written(tmp_path, *lines))
    assert len(made.scans) == 80
    assert [s.stamp for s in made.scans[:3]] == [5.0, 6.0, 7.0]
    assert made.odometry[79].pose.x == pytest.approx(7.9)


def test_a_line_whose_time_is_none_is_left_out(tmp_path):
    """It would be the last of the drive."""
    lines = [stamped(5.0 + k, 0.0, (0.1 * k, 0.0, 0.0)) for k in range(80)]
    lines[40] = stamped(1e18, 0.0, (4.0, 0.0, 0.0))
    lines[50] = stamped(55.0 - 7200.0, 0.0, (5.0, 0.0, 0.0))
    lines[75:] = [stamped(4000.0 + k, 0.0, (0.1 * k, 0.0, 0.0)) for k in range(75, 80)]  # a pause
    made = read_log(written(tmp_path, *lines, "ODOM 9 0 0 0 0 0 1e18 h 1e18"))
    assert len(made.scans) == len(made.odometry) == 78
    assert made.scans[-1].stamp == made.odometry[-1].stamp == 4079.0
    assert made.scans[0].stamp == made.odometry[0].stamp == 5.0
    said = "scans with a time far from those around them: 2, the first in line 41"
    assert made.left_out == said


def around(unit, backwards=1.0):
    """A drive along a quarter of a circle, its heading in some unit."""
    turns = [0.02 * k for k in range(80)]
    poses = [(3.0 * math.sin(a), 3.0 - 3.0 * math.cos(a), unit * a) for a in turns]
    if backwards < 0.0:
        poses = [(-x, -y, psi) for x, y, psi in poses]
    return [flaser(5.0 + k, pose=pose) for k, pose in enumerate(poses)]


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_headings_in_degrees_are_reported(tmp_path, direction):
    assert len(read_log(written(tmp_path, *around(1.0, direction))).scans) == 80
    with pytest.raises(CohelmError, match=r"a\.log: headings are in radians, got up to 90\.5"):
        read_log(written(tmp_path, *around(180.0 / math.pi, direction)))


def test_a_robot_that_drives_sideways_or_only_turns_is_read(tmp_path):
    sideways = [flaser(5.0 + k, pose=(0.1 * k, 0.0, math.pi / 2)) for k in range(80)]
    assert len(read_log(written(tmp_path, *sideways)).scans) == 80
    turning = [flaser(5.0 + k, pose=(0.0, 0.0, 0.2 * k)) for k in range(80)]  # more than once
    assert len(read_log(written(tmp_path, *turning)).scans) == 80


def test_a_log_without_valid_times_is_read_in_its_order(tmp_path):
    lines = [stamped(k % 2, 0.0, (0.1 * k, 0.0, 0.0)) for k in range(406)]
    made = read_log(written(tmp_path, *lines))
    assert len(made.scans) == len(made.odometry) == 406
    assert made.odometry[405].pose.x == pytest.approx(40.5)
    assert np.diff([s.stamp for s in made.scans]) == pytest.approx(0.1)


def test_scans_without_time_and_without_a_pose_of_their_own_are_refused(tmp_path):
    raw = "RAWLASER1 0 -1.5 3.0 1.5 30 0.01 0 3 1 2 3 0 0 host 0"
    with pytest.raises(CohelmError, match=r"the times of its 10 scans do not go on"):
        read_log(written(tmp_path, "ODOM 1 2 3 0 0 0 5.0 host 5.0", *([raw] * 10)))


def test_a_scan_that_was_written_down_twice_is_read_once(tmp_path):
    lines = [flaser(float(k)) for k in range(40)]
    made = read_log(written(tmp_path, *lines, lines[-1]))
    assert len(made.scans) == 40
    assert made.left_out == "scans with the time of another: 1, the first in line 41"


def described(first="-1.0", step="0.5", n=5, ranges="1 2 3 4 5"):
    """One scan of the newer kind, by what it says of its laser."""
    pose = "0 1.2 0 0 1 0 0 0 0 0.2 0.3 0"
    return f"ROBOTLASER1 0 {first} 3.1 {step} 80 0.01 0 {n} {ranges} {pose} 1.0 host 1.0"


@pytest.mark.parametrize("step", ["0", "-0.01", "nan", "90", "1e-9"])
def test_a_laser_that_goes_no_turn_is_reported(tmp_path, step):
    with pytest.raises(CohelmError, match=rf"a\.log: .*5 beams {float(step):g} apart.*radians"):
        read_log(written(tmp_path, described(step=step)))


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (described(first="nan"), "from nan on"),
        (described(n=1, ranges="2"), "holds no scan"),
        (flaser(1.0, n=200_000), "holds no scan"),
    ],
)
def test_a_laser_that_is_none_is_reported(tmp_path, line, said):
    with pytest.raises(CohelmError, match=rf"a\.log: .*{said}"):
        read_log(written(tmp_path, line))


def test_a_line_with_a_damaged_description_does_not_describe_the_laser(tmp_path):
    lines = [described(step="0").replace("1.0 host 1.0", "0.5 host 0.5"), described()]
    lines += [one.replace("1.0 host 1.0", "2.0 host 2.0") for one in lines[1:]]
    lidar = read_log(written(tmp_path, *lines)).lidar.lidar()
    assert lidar.step == pytest.approx(0.5)


def test_a_laser_of_a_few_degrees_is_not_read_as_one_in_radians(tmp_path):
    with pytest.raises(CohelmError, match=r"a\.log: field_of_view_deg is in degrees"):
        read_log(written(tmp_path, described(step="0.0174533")))


@pytest.mark.parametrize("unit", [100.0, 1000.0])
def test_ranges_in_centimetres_or_millimetres_are_reported(tmp_path, unit):
    ranges = [unit * (1.0 + 0.02 * k) for k in range(180)]
    with pytest.raises(CohelmError, match=r"a\.log: .*metres, got .* in the median"):
        read_log(written(tmp_path, flaser(1.0, ranges=ranges)))


def test_what_a_laser_reports_for_no_return_is_no_unit(tmp_path):
    (scan,) = read_log(written(tmp_path, flaser(1.0, ranges=[3.0] * 20 + [327.67] * 160))).scans
    assert np.isfinite(scan.ranges).sum() == 20


@pytest.mark.parametrize("ends", ["\n", "\r\n", "\r"])
def test_a_log_of_any_system_is_read_whole(tmp_path, ends):
    (tmp_path / "a.log").write_bytes(("\ufeff" + ends.join(map(flaser, (1.0, 2.0)))).encode())
    assert [s.stamp for s in read_log(tmp_path / "a.log").scans] == [1.0, 2.0]


def test_a_log_of_hours_is_read(tmp_path):
    """An hour of 180 beams ten times a second is 70 MB."""
    path, line = tmp_path / "long.log.gz", b"# " + 997 * b"x" + b"\n"
    path.write_bytes(gzip.compress(70_000 * line + flaser(1.0).encode(), 1))
    assert len(read_log(path).scans) == 1
