"""`cohelm map`: a drive's record becomes a map that localisation works on."""

import json
import math

import numpy as np
import pytest

from cohelm.perceive.pipeline import Perception
from cohelm.record.file import About, RecordWriter
from cohelm.scenario import load
from cohelm.scenario.worlds.maps import FREE, OCCUPIED, read_map
from cohelm.study import mapping
from tests.perceive.drives import LIDAR, TOUR, along, drive

SALLY = load.robot("sally").model_copy(update={"lidar": LIDAR})


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
        "map.yaml", "map.pgm", "map.png", "trajectory.csv", "mapping.json",
    }  # fmt: skip
    made = read_map(folder / "map.yaml")
    assert made.resolution == 0.05
    assert (made.cells == OCCUPIED).sum() > 200
    assert (made.cells == FREE).sum() > 20_000


def test_the_robot_finds_its_way_on_the_map_it_made(folder):
    made = read_map(folder / "map.yaml")
    truth = np.loadtxt(folder / "trajectory.csv", delimiter=",", skiprows=1)
    path = along(TOUR[:6])
    perception = Perception(SALLY, made.known(), None)
    from cohelm.core.frames import between, compose
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


def test_json_says_what_came_out(cohelm, record, tmp_path):
    done = cohelm("map", str(record), "--out", str(tmp_path / "m"), "--resolution", "0.1", "--json")
    assert done.code == 0
    said = json.loads(done.out)
    assert said["scans"] > 50
    assert said["resolution_m"] == 0.1
    assert (tmp_path / "m" / "map.yaml").exists()


def test_what_is_no_record_is_refused_in_one_sentence(cohelm, tmp_path):
    (tmp_path / "x.log").write_text("nothing to see\n")
    for given, said in (("nowhere.mcap", "can not be read"), ("x.log", "CARMEN")):
        done = cohelm("map", str(tmp_path / given))
        assert done.code == 2
        assert said in done.err


def test_live_a_record_is_mapped_while_it_is_being_written(tmp_path, monkeypatch):
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
        result = mapping.mapped(path, out, 0.05, lambda what, _share: told.append(what), live=True)
    assert len(waits) > 3
    assert [what for what in told if what.startswith("scan 1,")]
    rows = np.loadtxt(out / "trajectory.csv", delimiter=",", skiprows=1)
    assert len(rows) == result.scans > 50
    assert (np.diff(rows[:, 0]) > 0.0).all()
    assert np.diff(rows[:, 0]).max() < 0.15  # none is left out where the record was cut
    assert (read_map(out / "map.yaml").cells == OCCUPIED).sum() > 200
