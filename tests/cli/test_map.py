"""`cohelm map`: a map from the record of a drive."""

import errno
import json
import math
import os
import shutil
import signal

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.frames import between
from cohelm.core.interrupts import INTERRUPTS
from cohelm.core.types import Pose, Twist
from cohelm.perceive.map.mapper import Mapper
from cohelm.perceive.pipeline import Perception
from cohelm.record.file import About, RecordWriter
from cohelm.robot.port import Odometry
from cohelm.scenario import load
from cohelm.scenario.worlds.maps import FREE, OCCUPIED, OccupancyMap, read_map, write_map
from cohelm.study import map_check, mapping
from cohelm.study.map_files import shades
from cohelm.study.mapping_session import MappingSession
from tests.few import first
from tests.perceive.drives import LIDAR, TOUR, along, drive
from tests.scenario.test_carmen import flaser, written
from tests.study.test_bags import bag

SALLY = load.robot("sally").model_copy(update={"lidar": LIDAR})


def silent(_what, _share):
    """Nobody listens."""


class Written:
    """A record into which the readings of a drive go, each scan once."""

    def __init__(self, file) -> None:
        self.made = RecordWriter(file, About("drive", 946_684_800_000_000_000), SALLY)
        self._number = None

    def __call__(self, moment) -> None:
        self.made.write(moment.readings.odometry)
        scan = moment.readings.scan
        if scan is not None and scan.number != self._number:
            self._number = scan.number
            self.made.write(scan)


def test_a_folder_that_can_not_be_made_is_reported_before_anything_is_done(
    cohelm, record, folder, monkeypatch, tmp_path
):
    (tmp_path / "taken").write_text("in the way")
    for name in ("mapping.mapped", "map_check.checked"):
        monkeypatch.setattr(f"cohelm.study.{name}", lambda *_, **__: pytest.fail("it began"))
    for what in (record, folder / "map.yaml"):
        said = cohelm("map", what, "--out", "taken")
        assert said.code == 2
        assert "the folder taken can not be made (there is a file of that name): choose" in said.err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), "r.mcap is the record of a run, not of a robot's drive"),
        (("--robot", "sally"), "r.mcap holds no scan (/scan): give the record of a drive with a"),
    ],
)
def test_the_record_of_a_run_is_told_from_that_of_a_drive(cohelm, options, words, tmp_path):
    with (tmp_path / "r.mcap").open("wb") as file:
        write = RecordWriter(file, About("run", 946_684_800_000_000_000))
        write.write(Odometry(0.0, Pose(0.0, 0.0, 0.0), Twist(0.0, 0.0)))
        write.finish()
    said = cohelm("map", "r.mcap", *options)
    assert said.code == 2
    assert words in said.err


@pytest.fixture(scope="module")
def record(tmp_path_factory):
    path = tmp_path_factory.mktemp("drive") / "drive.mcap"
    with path.open("wb") as file:
        write = Written(file)
        for moment in drive(*along(TOUR[:6]), 1):
            write(moment)
        write.made.finish()
    return path


@pytest.fixture(scope="module")
def folder(record, tmp_path_factory):
    from cohelm.study.mapping import mapped

    out = tmp_path_factory.mktemp("map")
    told = []
    mapped(record, out, 0.05, lambda what, share: told.append((what, share)))
    assert any("scan" in what for what, _ in told)  # the bar has something to show
    return out


def test_the_folder_holds_a_map_for_map_server_and_a_picture(folder):
    assert {p.name for p in folder.iterdir()} == {
        "map.yaml", "map.pgm", "map.png", "trajectory.csv", "loops.csv", "mapping.json",
        "survey.npz",
    }  # fmt: skip
    made = read_map(folder / "map.yaml")
    assert made.resolution == 0.05
    assert (made.cells == OCCUPIED).sum() > 200
    assert (made.cells == FREE).sum() > 20_000


@pytest.mark.slow  # with another seed than --localise, below
def test_the_robot_localizes_on_the_map_it_made(folder):
    made = read_map(folder / "map.yaml")
    truth = np.loadtxt(folder / "trajectory.csv", delimiter=",", skiprows=1)
    path = along(TOUR[:6])
    perception = Perception(SALLY, made.known(), None)
    from cohelm.core.frames import compose
    from cohelm.core.types import Pose

    # the map's origin is the body at its first scan; the true pose there is the path's first
    perception.place(Pose(0.0, 0.0, 0.0), 0.05)
    off = []
    for moment in drive(*path, 7):
        seen = perception.take(moment.now, moment.readings)
        if moment.readings.scan is not None:
            true = between(path[0][0], moment.truth)
            off.append(math.hypot(seen.pose.x - true.x, seen.pose.y - true.y))
    assert len(truth) > 50
    assert compose(path[0][0], between(path[0][0], moment.truth)) == pytest.approx(moment.truth)
    assert np.sqrt(np.mean(np.square(off))) < 0.05
    assert not seen.lost


def test_the_drive_is_mapped_and_localized_on_the_map_in_one_go(cohelm, record, tmp_path):
    options = ("--resolution", "0.1", "--localise", "--json")
    done = cohelm("map", str(record), "--out", str(tmp_path / "m"), *options)
    assert done.code == 0
    said = json.loads(done.out)
    assert said["scans"] > 50
    assert said["resolution_m"] == 0.1
    assert (tmp_path / "m" / "map.yaml").exists()
    again = said["localized"]
    assert again["scans"] > 50
    assert again["lost_share"] == 0.0
    assert again["wrong_and_sure_share"] == 0.0
    assert again["rms_m"] < 0.05


def test_a_map_is_checked_and_drawn(cohelm, folder, tmp_path, monkeypatch):
    monkeypatch.setattr(map_check, "PLACES", 60)  # each is searched for on the whole map
    done = cohelm("map", str(folder / "map.yaml"), "--out", str(tmp_path / "c"), "--json")
    assert done.code == 0
    said = json.loads(done.out)
    assert said["places"] > 50
    assert said["open_m"] > 1.0
    assert (tmp_path / "c" / "check.png").exists()


def test_a_map_without_walls_is_refused_by_its_name(cohelm, tmp_path):
    cells = np.full((40, 40), FREE, dtype=np.int8)
    write_map(tmp_path, OccupancyMap(cells, 0.05, Pose(0.0, 0.0, 0.0)))
    done = cohelm("map", str(tmp_path / "map.yaml"), "--out", str(tmp_path / "c"))
    assert done.code == 2
    assert "map.yaml: the map has no occupied cell" in done.err.replace("\n", "")


@pytest.mark.parametrize(
    "options", [["--live"], ["--resume"], ["--localise"], ["--undo"], ["--scan-topic", "/scan"]]
)
def test_of_a_map_there_is_nothing_to_make(cohelm, folder, options):
    done = cohelm("map", str(folder / "map.yaml"), *options)
    assert done.code == 2
    assert "is a map: only --robot, --out and --json go with it" in done.err


def test_a_file_that_is_no_record_is_refused_in_one_sentence(cohelm, tmp_path):
    (tmp_path / "x.log").write_text("nothing to see\n")
    for given, said in (("nowhere.mcap", "can not be read"), ("x.log", "CARMEN")):
        done = cohelm("map", str(tmp_path / given))
        assert done.code == 2
        assert said in done.err


def test_what_of_a_carmen_log_could_not_be_used_is_said(cohelm, tmp_path):
    lines = [flaser(t, pose=(0.1 * t, 0.0, 0.0)) for t in (1.0, 2.0, 9e9, 3.0, 4.0, 5.0)]
    written(tmp_path, *lines)
    left_out = "scans with a time far from those around them: 1, the first in line 3"
    done = cohelm("map", "a.log", "--out", "m")
    assert done.code == 0, done.err
    assert f"warning: a.log: left out: {left_out}" in " ".join(done.err.split())
    assert json.loads((tmp_path / "m" / "mapping.json").read_text())["left_out"] == left_out


def test_a_bag_with_other_topics_is_mapped(cohelm, tmp_path):
    own = bag(tmp_path / "own", 2, step=0.01, scans=("/front", "/rear"))
    asked = cohelm("map", str(own), "--out", str(tmp_path / "m"))
    assert asked.code == 2
    assert "/front, /rear" in asked.err
    done = cohelm("map", str(own), "--scan-topic", "/rear", "--out", str(tmp_path / "m"), "--json")
    assert done.code == 0
    assert json.loads(done.out)["scans"] == 5
    assert (tmp_path / "m" / "map.yaml").exists()
    live = cohelm("map", str(own), "--live")
    assert live.code == 2
    assert "--live" in live.err


def test_an_earlier_mapping_is_not_overwritten(cohelm, record, folder, tmp_path):
    shutil.copytree(folder, tmp_path / "map")
    (tmp_path / "begun").mkdir()
    (tmp_path / "begun" / "survey.npz").write_bytes(b"of an interrupted one")
    before = (folder / "survey.npz").read_bytes()
    for options in ((str(record), "--out", "map"), (str(record), "--out", "begun"),
                    ("map", "--crop", "0:-1:3:1", "--out", "begun")):  # fmt: skip
        done = cohelm("map", *options)
        assert done.code == 2
        assert "already, and a mapping never overwrites" in " ".join(done.err.split())
    assert (tmp_path / "map" / "survey.npz").read_bytes() == before


def test_topics_are_for_bags(cohelm, tmp_path):
    (tmp_path / "x.log").write_text("nothing to see\n")
    done = cohelm("map", str(tmp_path / "x.log"), "--scan-topic", "/rear")
    assert done.code == 2
    assert "no ROS bag" in done.err


def test_a_record_is_mapped_while_it_is_written(tmp_path, monkeypatch):
    """The drive goes on whenever mapping waits for more of it; at its end comes Ctrl-C."""
    path = tmp_path / "drive.mcap"
    moments = iter(list(drive(*along(TOUR[:4]), 1)))
    with path.open("wb") as file:
        write, waits, told = Written(file), [], []

        def driven(_seconds):
            waits.append(path.stat().st_size)
            before = path.stat().st_size
            while path.stat().st_size == before:
                moment = next(moments, None)
                if moment is None:
                    raise KeyboardInterrupt
                write(moment)
                file.flush()

        driven(0.0)
        monkeypatch.setattr(mapping.time, "sleep", driven)
        out = tmp_path / "map"
        monkeypatch.setattr(mapping, "_SHOWN", 0.05)
        monkeypatch.setattr(mapping, "_DRAWING", 1.0)
        shown = set[int]()

        def tell(what, _share):
            told.append(what)
            if (out / "map.png").exists():
                shown.add((out / "map.png").stat().st_mtime_ns)

        result = mapping.mapped(path, out, 0.05, tell, live=True)
    assert len(shown) > 1  # before the map was made
    assert len(waits) > 3
    assert [what for what in told if what.startswith("scan 1,")]
    rows = np.loadtxt(out / "trajectory.csv", delimiter=",", skiprows=1)
    assert len(rows) == result.scans > 50
    assert (np.diff(rows[:, 0]) > 0.0).all()
    assert np.diff(rows[:, 0]).max() < 0.15  # none is left out where the record was cut
    assert (read_map(out / "map.yaml").cells == OCCUPIED).sum() > 200


def test_an_interrupted_mapping_resumes_and_makes_the_same_map(folder, record, tmp_path):
    def stop(what, _share):
        if what.startswith("scan 101"):
            raise KeyboardInterrupt

    with pytest.raises(mapping.Interrupted):
        mapping.mapped(record, tmp_path, 0.05, stop)
    # The picture that grows is drawn every few seconds: on a slow machine there is one by then.
    assert {p.name for p in tmp_path.iterdir()} - {"map.png"} == {"survey.npz"}
    heard = []
    mapping.mapped(record, tmp_path, None, lambda what, _: heard.append(what), resume=True)
    assert int(heard[0].removeprefix("scan ").split(",")[0]) > 100
    for name in ("map.pgm", "trajectory.csv"):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes()


@pytest.mark.parametrize("sent", first(INTERRUPTS))
def test_ctrl_c_in_the_middle_of_a_scan_is_taken_after_it(
    folder, record, tmp_path, monkeypatch, cohelm, sent
):
    class Pressed(Mapper):
        def add(self, sweep):
            super().add(sweep)
            if self.scans == 60:
                signal.raise_signal(sent)

    monkeypatch.setattr(mapping, "Mapper", Pressed)
    before = {one: signal.getsignal(one) for one in INTERRUPTS}
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # ignored where pytest is under nohup
    try:
        said = cohelm("map", record, "--resolution", 0.05, "--out", tmp_path)
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)
    assert said.code == 130
    assert "interrupted; the map so far is kept, continue with: cohelm map " in said.err
    monkeypatch.undo()
    assert MappingSession.read(tmp_path).complete
    mapping.mapped(record, tmp_path, None, silent, resume=True)
    assert (tmp_path / "map.pgm").read_bytes() == (folder / "map.pgm").read_bytes()


def test_on_a_full_disk_half_a_file_is_not_left(folder, tmp_path, monkeypatch):
    def full(file, **_):
        file.write(b"PK")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    session = MappingSession.read(folder)
    session.save(tmp_path)
    before = (tmp_path / "survey.npz").read_bytes()
    monkeypatch.setattr(np, "savez", full)
    with pytest.raises(CohelmError, match="No space left on device"):
        session.save(tmp_path)
    assert [file.read_bytes() for file in tmp_path.iterdir()] == [before]


def test_a_killed_campaign_continues_from_the_last_stored_episode(record, tmp_path, monkeypatch):
    monkeypatch.setattr(mapping, "_SAVED", 0.0)

    def stop(what, _share):
        if what.startswith("scan 101"):
            raise MemoryError

    with pytest.raises(MemoryError):
        mapping.mapped(record, tmp_path, 0.05, stop)
    assert len(MappingSession.read(tmp_path).stamps) == 100


def test_another_drive_continues_the_map_where_the_last_one_ended(folder, tmp_path):
    first = along(TOUR[:6])[0]
    path = along(TOUR[5:8])  # turned by 38 degrees
    shutil.copytree(folder, tmp_path / "map")
    with (tmp_path / "more.mcap").open("wb") as file:
        write = Written(file)
        for moment in drive(*path, 2):
            write(moment)
        write.made.finish()
    mapping.mapped(tmp_path / "more.mcap", tmp_path / "map", None, silent, resume=True)
    rows = np.loadtxt(tmp_path / "map/trajectory.csv", delimiter=",", skiprows=1)
    before = np.loadtxt(folder / "trajectory.csv", delimiter=",", skiprows=1)
    end = between(first[0], moment.truth)
    assert len(rows) > len(before) + 20
    assert math.hypot(rows[-1, 1] - end.x, rows[-1, 2] - end.y) < 0.1


def test_a_drive_that_begins_elsewhere_is_not_appended(folder):
    survey = MappingSession.read(folder).survey
    survey.set_down()
    (seen,) = mapping.mapping_scans(LIDAR.lidar(), *scanned(along(TOUR[8:10])))
    with pytest.raises(CohelmError, match="not what was seen where the last one ended"):
        survey.add(seen)


def scanned(path):
    """Odometry and the first scan of a drive."""
    odometry = []
    for moment in drive(*path, 3):
        odometry.append(moment.readings.odometry)
        if moment.readings.scan is not None and moment.now > 0.5:
            return odometry, [moment.readings.scan]
    raise AssertionError("no scan came")


def test_cuts_and_crops_of_a_mapping_can_be_undone(folder, tmp_path, cohelm):
    shutil.copytree(folder, tmp_path / "map")
    whole = (folder / "map.pgm").read_bytes()
    done = cohelm("map", "map", "--crop", "0:-1.5:3:1", "--json")
    assert done.code == 0
    assert json.loads(done.out)["marks"] == ["--crop 0:-1.5:3:1"]
    made = read_map(tmp_path / "map/map.yaml")
    assert made.cells.shape == pytest.approx((50, 60), abs=1)
    done = cohelm("map", "map", "--undo", "--cut", "5:1e9", "--json")
    assert json.loads(done.out)["marks"] == ["--cut 5:1e+09"]
    cut = (read_map(tmp_path / "map/map.yaml").cells == FREE).sum()
    assert cut < 0.8 * (read_map(folder / "map.yaml").cells == FREE).sum()
    assert cohelm("map", "map", "--undo").code == 0
    assert (tmp_path / "map/map.pgm").read_bytes() == whole


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("map", "--undo"), "nothing to undo"),
        (("map", "--remove-loop", "999"), "there is no loop 999"),
        (("map", "--crop", "90:90:99:99"), "is not on the map"),
        (("map", "--crop", "1:2"), "is not X:Y:X:Y in metres"),
        (("map", "--cut", "9:1"), "ends before it begins"),
        (("map", "--cut", "0:1e9"), "nothing is left to draw"),
        (("map", "--live"), "are for a record"),
        ((".", "--undo"), ".: holds no survey.npz: name the folder of a mapping"),
        ((".",), "or the record of a drive to map (--out is the folder that it writes into)"),
        (("map/map.png", "--undo"), "name its folder instead of a record"),
        (("map/map.png", "--resume", "--out", "nowhere"), "nowhere: holds no survey.npz"),
    ],
)
def test_invalid_marks_are_refused_in_one_sentence(folder, tmp_path, cohelm, options, said):
    (tmp_path / "map").symlink_to(folder)
    before = (folder / "survey.npz").read_bytes()
    done = cohelm("map", *options)
    assert done.code == 2
    assert said in " ".join(done.err.split())
    assert (folder / "survey.npz").read_bytes() == before


def test_a_damaged_mapping_is_reported(folder, tmp_path):
    with np.load(folder / "survey.npz") as file:
        whole = dict(file)
    for name, spoil in (
        ("across", lambda a: a[:-5]), ("points", lambda a: a * math.nan), ("size", lambda a: -a),
        ("points", lambda a: np.zeros((3, 3, 3))), ("poses", lambda a: a[:-1]),
        ("joint", lambda a: np.eye(2)), ("scans", lambda a: a + 1e6), ("links", lambda a: a + 1e6),
    ):  # fmt: skip
        spoiled = {f"survey_{name}": spoil(whole[f"survey_{name}"])}
        np.savez(tmp_path / "survey.npz", allow_pickle=False, **(whole | spoiled))
        with pytest.raises(CohelmError, match="is damaged: map the record again"):
            MappingSession.read(tmp_path)
    for damaged in (b"", b"PK", (folder / "survey.npz").read_bytes()[:2000]):
        (tmp_path / "survey.npz").write_bytes(damaged)
        with pytest.raises(CohelmError, match="is damaged: map the record again"):
            MappingSession.read(tmp_path)


def test_a_thin_wall_is_visible_in_a_small_picture():
    """Averaged, the walls of a map of 40 m in cells of 2.5 cm are a light grey."""
    occupied = np.zeros((1700, 1501), np.bool_)
    occupied[:, 1500] = occupied[40, :] = True
    free = np.zeros_like(occupied)
    free[:800] = ~occupied[:800]
    shown, cells = shades(occupied, free, 700)
    assert cells == 3
    assert shown.shape == (567, 501)
    assert (shown[:, 500] == 0).all()
    assert (shown[13] == 0).all()
    assert shown[100, 100] == 255
    assert shown[400, 100] == 190
    assert shades(occupied[:50, :60], free[:50, :60], 700)[1] == 1
