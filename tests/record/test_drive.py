"""Records of drives are read back as written, complete or cut short."""

import re

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from cohelm.core.errors import CohelmError
from cohelm.core.row import ROW
from cohelm.core.types import Pose, Twist
from cohelm.record import period
from cohelm.record.file import About, RecordWriter
from cohelm.record.messages import messages
from cohelm.record.read import read_record
from cohelm.record.replay import Replayed, recorded_model
from cohelm.record.shown import TOPICS as SHOWN_TOPICS, from_message
from cohelm.record.topics import TOPICS
from cohelm.robot.keep.record_pipe import Event
from cohelm.robot.port import Odometry
from cohelm.scenario.load import robot as load_robot
from cohelm.sim.kinematic import Kinematic
from tests.ports.adapters import SHOWN, recorded, room, sally

EPOCH = 1_700_000_000_000_000_000


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    return recorded(tmp_path_factory.mktemp("drive") / "drive.mcap", 3.0)


def test_the_replayed_drive_senses_what_the_driven_one_did(drive):
    robot = Kinematic(sally(), obstacles=room(), seed=4)
    again = Replayed(drive)
    assert again.model == robot.model
    for k in range(100):
        robot.send(Twist(0.3, 0.4))
        then, now = robot.read(), again.read()
        assert now.odometry.stamp == pytest.approx(then.odometry.stamp, abs=2e-9)
        assert now.odometry.pose == pytest.approx(then.odometry.pose, abs=1e-9)
        assert now.odometry.twist == pytest.approx(then.odometry.twist, abs=1e-12)
        assert now.scan.number == then.scan.number
        assert np.allclose(now.scan.ranges, then.scan.ranges, rtol=1e-6)
        for one in (robot, again):
            one.wait(0.02 * (k + 1))


def test_a_replayed_robot_ignores_commands(drive):
    robot = Replayed(drive)
    robot.wait(1.0)
    robot.stop()
    assert robot.send(Twist(9.0, 9.0)) == Twist(0.3, 0.4)
    assert robot.read().odometry.twist.v > 0.2


def test_after_the_end_of_a_record_there_are_no_new_readings(drive):
    robot = Replayed(drive)
    assert robot.duration == pytest.approx(3.0, abs=0.03)
    robot.wait(99.0)
    assert robot.read().odometry.stamp == pytest.approx(robot.duration)


def test_an_independent_reader_decodes_every_message(drive):
    with drive.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        seen = {channel.topic for _, channel, _, _ in reader.iter_decoded_messages()}
    assert seen == set(TOPICS)


def test_shown_messages_are_read_back(drive):
    back = [from_message(topic, said) for topic, _, said in messages(drive, list(SHOWN_TOPICS))]
    assert repr(back) == repr(list(SHOWN))


def test_a_period_comes_back_to_the_last_bit(tmp_path):
    row = np.zeros((), dtype=ROW)
    for i, name in enumerate(ROW.names):
        row[name] = i + 0.1 if ROW[name] == np.float64 else i % 2
    row["sigma"], row["clearance_seen"] = np.nan, np.inf
    path = tmp_path / "one.mcap"
    with path.open("wb") as file:
        made = RecordWriter(file, About("drive", EPOCH), sally())
        made.period(row)
        made.write(Event(1.0, "gate", "AUTOMATIC -> STOPPED: why", True))
        made.finish()
    (back,) = period.rows([m for _, _, m in messages(path, ("/period",))])
    assert back.tobytes() == row.tobytes()
    ((_, stamp, said),) = messages(path, ("/rosout",))
    assert (stamp, said.name, said.level) == (EPOCH + 10**9, "gate", 40)
    assert said.msg == "AUTOMATIC -> STOPPED: why"


@pytest.mark.parametrize("psi", [np.inf, np.nan])
def test_odometry_that_is_not_finite_is_recorded_without_a_transform(tmp_path, psi):
    row = np.zeros((), dtype=ROW)
    path = tmp_path / "one.mcap"
    with path.open("wb") as file:
        made = RecordWriter(file, About("drive", EPOCH), sally())
        made.write(Odometry(0.0, Pose(0.0, 0.0, psi), Twist(0.0, 0.0)))
        made.write(row.tobytes())
        made.finish()
    assert len(list(messages(path, ("/odom", "/period")))) == 2
    frames = [m.transforms[0].child_frame_id for _, _, m in messages(path, ("/tf",))]
    assert frames == ["base_link"]


@pytest.mark.parametrize("wrong", [Pose(np.nan, 0.0, 0.0), Pose(0.0, 0.0, np.nan)])
def test_after_odometry_that_is_no_number_the_replayed_robot_goes_on(tmp_path, wrong):
    """It has faulted the drive; after a reset that went on."""
    path = tmp_path / "one.mcap"
    with path.open("wb") as file:
        made = RecordWriter(file, About("drive", EPOCH), sally())
        for k in range(5):
            pose = wrong if k == 2 else Pose(0.1 * k, 0.0, 0.2 * k)
            made.write(Odometry(0.02 * k, pose, Twist(0.0, 0.0)))
        made.finish()
    poses = [one.pose for one in Replayed(path).odometry]
    assert np.allclose(poses, [(0.1 * k, 0.0, 0.2 * k) for k in (0, 1, 3, 4)])


def test_after_a_clock_went_back_readings_count_once_it_is_as_late_again(tmp_path):
    """Scans as odometry: else scans of one time meet the odometry of another."""
    path, robot = tmp_path / "one.mcap", Kinematic(sally(), Pose(0.0, 0.0, 0.0), room(), seed=4)
    with path.open("wb") as file:
        made = RecordWriter(file, About("drive", EPOCH), sally())
        scan = robot.read().scan
        for k in range(8):
            stamp = 0.1 * (k if k < 4 else k - 3)  # 0 to 0.3, then 0.1 to 0.4
            made.write(Odometry(stamp, Pose(float(k), 0.0, 0.0), Twist(0.0, 0.0)))
            made.write(scan._replace(stamp=stamp, number=k))
        made.finish()
    again = Replayed(path)
    assert [one.pose.x for one in again.odometry] == [0.0, 1.0, 2.0, 3.0, 7.0]
    assert [one.stamp for one in again.scans] == [one.stamp for one in again.odometry]


@pytest.mark.parametrize("buffering", [0, -1])
def test_flushed_messages_are_in_the_file_and_a_finished_file_has_its_end(tmp_path, buffering):
    path = tmp_path / "one.mcap"
    with path.open("wb", buffering=buffering) as file:
        made = RecordWriter(file, About("drive", EPOCH), sally())
        made.write(Event(1.0, "gate", "one", True))
        made.flush()
        assert [m.msg for _, _, m in messages(path, ("/rosout",))] == ["one"]
        made.write(Event(2.0, "gate", "two", True))
        made.finish()
        with path.open("rb") as again:  # by its index, which is at the very end
            said = [message for _, _, message in make_reader(again).iter_messages(("/rosout",))]
        assert len(said) == 2


def test_a_drive_that_was_cut_short_is_read_as_far_as_it_goes(drive, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(drive.read_bytes()[: drive.stat().st_size // 2])
    assert 0.2 < Replayed(cut).duration < 2.9


def test_wherever_a_file_was_cut_it_is_said_to_end_too_early(tmp_path):
    """Within a record's head, too, which mcap takes for damage."""
    path = tmp_path / "one.mcap"
    with path.open("wb") as file:
        made = RecordWriter(file, About("drive", EPOCH), sally())
        made.flush()
        begun = file.tell()
        made.write(Event(1.0, "gate", "one", True))
        made.flush()
    whole = path.read_bytes()
    assert len(whole) > begun + 9
    for length in range(begun, len(whole)):
        path.write_bytes(whole[:length])
        said = []
        list(messages(path, ("/rosout",), said.append))
        assert said == ["it ends too early"]


def test_a_file_that_is_no_record_is_reported_as_such(tmp_path):
    text = tmp_path / "text.mcap"
    text.write_text("nothing of the kind, and long enough to be read as something")
    with pytest.raises(CohelmError, match="not an MCAP file"):
        Replayed(text)
    with pytest.raises(CohelmError, match="can not be read"):
        Replayed(tmp_path / "none.mcap")


def test_a_record_without_odometry_or_robot_is_refused_with_the_cure(drive, tmp_path):
    empty = tmp_path / "empty.mcap"
    with empty.open("wb") as file:
        RecordWriter(file, About("drive", EPOCH), sally()).finish()
    assert recorded_model(empty) == sally()
    with pytest.raises(CohelmError, match="holds no odometry"):
        Replayed(empty)


def test_a_damaged_description_of_the_robot_is_told_in_one_line(tmp_path, monkeypatch):
    with (tmp_path / "x.mcap").open("wb") as file:
        RecordWriter(file, About("drive", EPOCH), sally()).finish()
    for text, why in (
        (sally().model_dump_json().replace('"limits"', '"lamits"'), "lamits: Extra inputs"),
        ("{", "Expecting property name"),
    ):
        monkeypatch.setattr("cohelm.record.replay.attachment", lambda _, name, t=text: t.encode())
        with pytest.raises(CohelmError, match=rf"robot is damaged: .*{why}[^\n]*$"):
            recorded_model(tmp_path / "x.mcap")


def test_unknown_message_types_are_refused(tmp_path):
    with (tmp_path / "x.mcap").open("wb") as file:
        made = RecordWriter(file, About("drive", EPOCH), sally())
        with pytest.raises(TypeError, match="does not hold a str"):
            made.write("nonsense")
        made.write(Odometry(0.0, Pose(0.0, 0.0, 0.0), Twist(0.0, 0.0)))
        made.finish()


def test_the_scans_of_further_lidars_are_kept_and_played_back(tmp_path):
    model, path = load_robot("sally-rear"), tmp_path / "two.mcap"
    robot = Kinematic(model, obstacles=room(), seed=4)
    with path.open("wb") as file:
        made = RecordWriter(file, About("drive", EPOCH), model)
        for k in range(30):
            readings = robot.read()
            made.write(readings.odometry)
            if k % 5 == 0:
                made.write(readings.scan)
                made.write(readings.further[0])
            made.period(np.zeros((), dtype=ROW))
            robot.wait(0.02 * (k + 1))
        made.finish()
    kept = read_record(path)
    assert list(kept.further_scans) == ["rear"]
    assert len(kept.further_scans["rear"]) == len(kept.scans) == 6
    again, then = Replayed(path), Kinematic(model, obstacles=room(), seed=4)
    for one in (again, then):
        one.wait(0.3)
    (back,), (was,) = again.read().further, then.read().further
    assert (back.sensor, back.number) == (was.sensor, was.number) == ("rear", 3)
    assert np.allclose(back.ranges, was.ranges, rtol=1e-6)
    assert not np.allclose(back.ranges, again.read().scan.ranges, rtol=1e-3)


def test_a_record_summarizes_its_content_in_one_line(tmp_path):
    """In a notebook, the whole of a minute's scans would be twenty thousand lines."""
    path = tmp_path / "short.mcap"
    with path.open("wb") as file:
        made = RecordWriter(file, About("drive", EPOCH), load_robot("sally"))
        made.period(np.zeros((), dtype=ROW))
        made.finish()
    assert re.fullmatch(
        r"Record\(kind='drive', table: \d+ columns of 1, 0 scans, 0 events\)",
        repr(read_record(path)),
    )
