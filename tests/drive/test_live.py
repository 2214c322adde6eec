"""The live view: the messages of a record, read-only, without delaying the loop."""

import asyncio
import itertools
import json
import os
import pickle
import signal
import socket
import time
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import ANY

import foxglove
import pytest
from mcap.reader import make_reader
from mcap.records import Channel, Message
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from cohelm.cli.live import live as live_view
from cohelm.cli.robot import failures, rows
from cohelm.core.errors import CohelmError
from cohelm.drive import live as of_live
from cohelm.drive.factory import simulated
from cohelm.drive.live import QUEUE_LIMIT, Live, LiveConfig, _Viewer
from cohelm.drive.session import Session, SessionConfig
from cohelm.link.messages import Mode
from cohelm.loop.drive_log import DriveLog
from cohelm.record.messages import records
from cohelm.record.topics import IMAGE, LASTING, definitions
from cohelm.robot.keep.gated_robot import LocalGatedRobot, rules
from cohelm.robot.keep.record_pipe import RecordLine, line
from cohelm.robot.port import Encoded
from cohelm.sim.kinematic import Kinematic
from tests import own_loop
from tests.drive.onlooker import HEAD, Onlooker
from tests.robot.keep.robots import SALLY

ONCE = {"/tf_static", "/scene", "/map", "/reference"}
"""What a drive says at its beginning."""


def recorded(path: Path) -> dict[str, list[tuple[int, bytes]]]:
    """By topic, in order: stamps and bytes."""
    names: dict[int, str] = {}
    found: dict[str, list[tuple[int, bytes]]] = {}
    for one in records(path):
        if isinstance(one, Channel):
            names[one.id] = one.topic
        elif isinstance(one, Message):
            found.setdefault(names[one.channel_id], []).append((one.log_time, one.data))
    return found


def part(of: list, whole: list) -> bool:
    """Whether it is a piece of it, without a gap."""
    n = len(of)
    return any(whole[i : i + n] == of for i, one in enumerate(whole) if one == of[0])


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """A drive that is recorded, and looked on at from some moment; then the live view is killed."""
    seen = SimpleNamespace(path=tmp_path_factory.mktemp("live") / "drive.mcap")
    plan = SessionConfig(
        simulated("lab-guard", real_time=False), record=seen.path, live=LiveConfig(port=0)
    )
    with Session(plan) as session:
        marks = itertools.count()

        def on(seconds: float) -> int:
            until, before = (
                session.loop.gated.now() + seconds,
                session.loop.timing.punctuality().periods,
            )
            session.run(lambda loop: loop.gated.now() >= until, Mode.AUTOMATIC)
            return session.loop.timing.punctuality().periods - before

        def all_shown(to: Onlooker) -> None:
            """In simulated time the live view comes after."""
            to.listen(lambda: to.heard["/tf_static"] != [])  # so it is subscribed
            mark = f"mark {next(marks)}"
            session.loop.log.event(mark)
            to.listen(lambda: any(mark.encode() in said for _, said in to.heard["/rosout"]))

        on(1.0)
        seen.first = Onlooker(session.live.address)
        all_shown(seen.first)
        seen.at_once = {topic: list(seen.first.heard[topic]) for topic in ONCE}
        seen.periods = on(1.5)
        all_shown(seen.first)
        seen.later = Onlooker(session.live.address)
        all_shown(seen.later)
        of = {"recorder": session.recording.pid, "live view": session.live.pid}
        seen.loaded = {who: Path(f"/proc/{pid}/maps").read_text() for who, pid in of.items()}
        seen.before = session.loop.supervisor.mode, session.loop.alarms.worst()
        os.kill(session.live.pid, signal.SIGKILL)
        session.live._process.join()
        seen.on_after = on(0.5)
        seen.after = session.loop.supervisor.mode, session.loop.alarms.worst()
        os.kill(session.recording.pid, signal.SIGSTOP)
        seen.spoken = [f"{who} {k}" for k in range(3) for who in ("gate", "loop")]
        for what in seen.spoken:
            (session.gated.log if "gate" in what else session.loop.log.event)(what)
        os.kill(session.recording.pid, signal.SIGCONT)
        session.end("the drive is over")
        seen.summary = session.summary()
    seen.summary |= session.record_summary()
    seen.first.close()
    seen.later.close()
    return seen


def test_the_live_view_has_the_messages_of_the_record(drive):
    record = recorded(drive.path)
    assert set(drive.first.heard) == set(record) - {"/detour"}
    for topic, live in drive.first.heard.items():
        assert part(live, record[topic]), topic
    for topic in ("/period", "/odom", "/cmd_vel", "/cmd_vel_safe", "/joy"):
        assert len(drive.first.heard[topic]) >= drive.periods - 2 >= 70, topic
    assert len(drive.first.heard["/scan"]) >= 10


def test_viewers_receive_messages_of_loop_and_gate_in_their_order(drive):
    """In simulated time they are one process, and often speak at one stamp."""
    said = b"".join(data for _, data in recorded(drive.path)["/rosout"])
    found = [said.index(what.encode()) for what in drive.spoken]
    assert found == sorted(found)


def test_the_channels_are_the_topics_of_a_record(drive):
    with drive.path.open("rb") as file:
        summary = make_reader(file).get_summary()
    of_record = {
        (one.topic, one.message_encoding, schema.name, schema.encoding, schema.data.decode())
        for one in summary.channels.values()
        for schema in (summary.schemas[one.schema_id],)
    }
    names = ("topic", "encoding", "schemaName", "schemaEncoding", "schema")
    assert {tuple(one[name] for name in names) for one in drive.first.channels} == of_record


@pytest.mark.parametrize("who", ["recorder", "live view"])
def test_processes_that_only_receive_messages_never_load_the_compiler(drive, who):
    """Nothing in what it is told wants it either."""
    assert "numpy" in drive.loaded[who]
    assert "llvmlite" not in drive.loaded[who]


def test_a_late_viewer_receives_the_latched_messages(drive):
    record = recorded(drive.path)
    for topic in ONCE:
        assert drive.at_once[topic] == [record[topic][-1]]
        assert drive.later.heard[topic] == [record[topic][-1]]
    for topic in {"/diagnostics", "/obstacles"} & set(drive.later.heard):
        assert drive.later.heard[topic][0] in record[topic]
    assert len(drive.later.heard["/diagnostics"]) >= 1
    assert {*ONCE, "/diagnostics"} <= LASTING


def test_a_dead_live_view_stops_nothing_and_is_reported(drive):
    said = "the live view has ended: the robot continues without it"
    assert drive.on_after >= 20
    assert drive.before[0] == drive.after[0] == Mode.AUTOMATIC
    assert said not in [alarm.text for alarm in drive.before[1]]
    assert said in [alarm.text for alarm in drive.after[1]]
    assert drive.path.with_suffix(".log").read_text().count(said) == 1
    assert drive.summary["record_whole"]
    assert any("live view" in one for one in failures(drive.summary))
    assert ("live view", "ended before the drive") in rows(drive.summary)


def test_recording_begins_and_ends_while_it_is_shown():
    """As somebody at the link asks for: whatever is recorded, all of it is shown."""
    (loop, hears), shown = line(), []
    log = DriveLog(RecordLine(None), lambda: 1.0, RecordLine(loop))
    gated = LocalGatedRobot(Kinematic(SALLY, seed=1), rules(SALLY, 0.02), viewer=shown.append)
    for turn in range(3):
        (of_loop, hears_loop), (of_gate, hears_gate) = line(), line()
        log.set_recorder(RecordLine(of_loop if turn == 1 else None))
        gated.record_into(of_gate if turn == 1 else None)
        log.event(f"event {turn}")
        gated.log(f"gate {turn}")
        for one in (of_loop, hears_loop, of_gate, hears_gate):
            one.close()
    assert [pickle.loads(hears.recv(1000)).text for _ in range(3)] == [
        "event 0", "event 1", "event 2"
    ]  # fmt: skip
    assert [one.text for one in shown if "gate" in one.text] == ["gate 0", "gate 1", "gate 2"]
    loop.close()
    hears.close()


@pytest.fixture(scope="module")
def live():
    """A server by itself, of a drive that has begun."""
    made = Live(LiveConfig(port=0), SALLY)
    made.begin(10**18)
    yield made
    made.close()


def test_pictures_are_requested_only_while_there_is_a_viewer(live):
    loop = RecordLine(live.loop)

    def asked() -> object:
        end = time.monotonic() + 30.0
        while (said := loop.received()) is None:
            assert time.monotonic() < end
            time.sleep(0.05)
        return said

    viewer = Onlooker(live.address, [IMAGE])
    assert asked() is True
    viewer.close()
    assert asked() is False


def of_memory(pid: int) -> int:
    """[B], resident."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def test_a_viewer_that_never_reads_uses_no_memory_and_blocks_no_other(live):
    photo, camera = os.urandom(100_000), RecordLine(live.loop)
    reads = Onlooker(live.address, [IMAGE])
    lazy = [
        Onlooker(live.address, max_queue=1, close_timeout=0.1) for _ in range(3)
    ]  # as far as the sockets hold
    before = of_memory(live.pid)
    for k in range(250):  # 25 MB for each
        camera(Encoded(0.1 * k, k, photo))
        if k % 5 == 4:
            reads.listen(lambda k=k: len(reads.heard[IMAGE]) > k)
        if k == 50:
            settled = of_memory(live.pid)
    assert settled - before < 8 * QUEUE_LIMIT
    assert of_memory(live.pid) - settled < 8 * QUEUE_LIMIT  # 60 MB were not taken
    assert camera.dropped == 0
    for one in lazy:
        one.listen(lambda one=one: {"/tf_static", "/scene"} <= set(one.heard))
        one.close()
    reads.close()


class Full:
    """A connection that takes nothing any more."""

    def __init__(self) -> None:
        self.transport, self.over = self, False

    async def send(self, _) -> None:
        await asyncio.sleep(60.0)

    def abort(self) -> None:
        self.over = True


def test_a_viewer_that_never_reads_is_disconnected(monkeypatch):
    monkeypatch.setattr(of_live, "STUCK_TIMEOUT", 0.05)
    connection = Full()
    own_loop.run(_Viewer(connection, ["hello"]).send_queue())
    assert connection.over


def test_latched_messages_are_not_dropped_for_a_slow_viewer():
    async def slow() -> list:
        viewer = _Viewer(Full(), [])
        for number, topic in enumerate([IMAGE, "/map", "/scene"]):
            viewer.subscribe(topic, number)
        for k in range(40):
            viewer.give(IMAGE, k, bytes(100_000))
            viewer.give("/map", k, bytes(200_000))
        viewer.give(IMAGE, 40, bytes(100_000))
        viewer.give("/scene", 0, b"")
        viewer.give("/odom", 0, b"not asked for")
        return list(viewer._waiting)

    waiting = own_loop.run(slow())
    assert sum(len(data) for _, data in waiting) < QUEUE_LIMIT + 300_000
    stamps = {topic: HEAD.unpack_from(data)[2] for topic, data in waiting}
    assert stamps == {IMAGE: 40, "/map": 39, "/scene": 0}


def test_the_live_view_is_read_only(live):
    viewer = Onlooker(live.address, [])
    assert viewer.info["capabilities"] == []
    channel = {"id": 1, "topic": "/cmd_vel", "encoding": "cdr", "schemaName": "x"}
    viewer.say(op="advertise", channels=[channel])
    viewer.say(op="setParameters", parameters=[])
    viewer.connection.send(b"\x01\x01\x00\x00\x00drive")
    subscribe = '{"op": "subscribe", "subscriptions": %s}'
    for nonsense in (
        "", "[]", "{}", '{"op": "subscribe"}', subscribe % 1, subscribe % '[{"id": 1}]',
        subscribe % '[{"id": -1, "channelId": 1}]', subscribe % '[{"id": 1, "channelId": [1]}]',
    ):  # fmt: skip
        viewer.connection.send(nonsense)
    viewer.listen(lambda: len(viewer.told) == 11)
    assert {one["level"] for one in viewer.told} == {2}
    number = next(one["id"] for one in viewer.channels if one["topic"] == "/scene")
    viewer.say(op="subscribe", subscriptions=[{"id": number, "channelId": number}])
    viewer.listen(lambda: viewer.heard["/scene"] != [])
    viewer.say(op="unsubscribe", subscriptionIds=[number])
    viewer.close()


@pytest.mark.parametrize("path", ["", "wrong", "../", "%00", "?token="])
def test_without_the_token_no_viewer_connects(live, path):
    address = live.address.rpartition("/")[0] + "/" + path
    with pytest.raises(InvalidStatus) as refused:
        connect(address, subprotocols=["foxglove.sdk.v1"], proxy=None, legacy=True)
    assert refused.value.response.status_code == 401
    assert b"whole address" in refused.value.response.body


@pytest.mark.parametrize("protocol", ["foxglove.sdk.v1", "foxglove.websocket.v1"])
def test_the_greeting_is_that_of_foxgloves_own_server(live, protocol):
    """The SDK's takes the newer protocol only; Lichtblick may speak the older one."""
    context, theirs = foxglove.Context(), foxglove.start_server
    server = theirs(name="x", port=0, context=context)
    for topic, (name, text) in definitions(SALLY).items():
        foxglove.Channel(
            topic, message_encoding="cdr", context=context,
            schema=foxglove.Schema(name=name, encoding="ros2msg", data=text.encode()),
        )  # fmt: skip
    sdk = Onlooker(f"ws://127.0.0.1:{server.port}", [])
    own = connect(live.address, subprotocols=[protocol], proxy=None, legacy=True)
    assert own.subprotocol == protocol
    info, advertised = (json.loads(own.recv(10.0)) for _ in range(2))
    assert {"op", "name", "capabilities", "sessionId"} <= set(sdk.info) <= set(info)

    def channels(all_of_them) -> dict[str, dict]:
        return {one.pop("topic"): one for one in all_of_them if one.pop("id")}

    assert channels(advertised["channels"]) == channels(sdk.channels)
    own.close()
    sdk.close()
    server.stop()


def test_a_port_in_use_is_reported_in_one_sentence():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(
            CohelmError, match=rf"port {port} \(Address already in use\): .*--foxglove"
        ):
            Live(LiveConfig(port=port), SALLY)


def test_the_address_of_the_live_view_has_brackets_or_the_host_name():
    assert LiveConfig("::1", 5, "t").address == "ws://[::1]:5/t"
    assert LiveConfig("0.0.0.0", 5, "t").address == f"ws://{socket.gethostname()}:5/t"
    assert LiveConfig().token != LiveConfig().token


def test_listening_on_the_network_prints_a_warning(capsys):
    assert live_view("localhost") == LiveConfig("localhost", token=ANY)
    assert live_view("[::1]:99") == LiveConfig("::1", 99, token=ANY)
    assert capsys.readouterr().err == ""
    assert live_view("0.0.0.0") == LiveConfig("0.0.0.0", token=ANY)
    said = " ".join(capsys.readouterr().err.split())
    assert "whoever can listen on this network can see what the robot's camera sees" in said
