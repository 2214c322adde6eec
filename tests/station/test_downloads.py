"""Downloads of records: complete or failed, with bounded memory."""

from __future__ import annotations

import base64
import hashlib
import http.client
import json
import os
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from cohelm.core.types import Pose
from cohelm.link import congestion, robot_bulk
from cohelm.link.bulk_messages import Fetch, HealthReport, Picture, Piece
from cohelm.link.robot_records import RecordTransfer
from cohelm.link.station_bulk import StationBulk
from cohelm.link.station_end import StationEnd
from cohelm.station import records
from cohelm.station.serve import Server
from tests.link.ends import until
from tests.station.bare import Bare
from tests.station.servers import served
from tests.station.visitor import asked, session

pytestmark = pytest.mark.xdist_group("realtime")
SPARSE = 300_000_000
MEMORY = 24_000_000
"""What a download may take of the station's and the robot's memory together [byte]: what is on its
way, 1 MB, several times over in Python, TLS and the kernel, and what the allocator keeps."""


@pytest.fixture(autouse=True)
def _fast_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bulk begins with 256 kB/s and doubles that in 0.7 s (tests/link/test_bulk.py)."""

    class Fast(congestion.CongestionControl):
        def __init__(self, now: float) -> None:
            super().__init__(now)
            self.rate = congestion.FASTEST / 5.0

    monkeypatch.setattr(robot_bulk, "CongestionControl", Fast)


@pytest.fixture
def bare(tmp_path: Path) -> Iterator[Bare]:
    with Bare(tmp_path) as made:
        yield made


@pytest.fixture
def server(bare: Bare) -> Iterator[Server]:
    with served(bare.connect) as made:
        yield made


def written(folder: Path, size: int) -> bytes:
    content = os.urandom(size)
    (folder / "run.mcap").write_bytes(content)
    return content


def shown(server: Server) -> dict[str, str]:
    return {"authorization": f"Bearer {session(server)}"}


def begun(
    server: Server, path: str, **headers: str
) -> tuple[http.client.HTTPConnection, http.client.HTTPResponse]:
    """A download whose body has not been read, by a client with a small buffer."""
    link = http.client.HTTPConnection("127.0.0.1", server.port, timeout=120)
    link.sock = socket.socket()
    link.sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 65_536)
    link.sock.settimeout(120)
    link.sock.connect(("127.0.0.1", server.port))
    link.request("GET", path, headers={**shown(server), **headers})
    return link, link.getresponse()


def memory() -> int:
    """Of this process, robot and station both [byte]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def test_a_download_is_complete_with_length_and_hash(server: Server, tmp_path: Path) -> None:
    content = written(tmp_path, 700_001)
    link, answer = begun(server, "/records/run.mcap")
    assert answer.status == 200
    assert answer.headers["content-length"] == str(len(content))
    digest = hashlib.sha256(content)
    assert (
        answer.headers["repr-digest"] == f"sha-256=:{base64.b64encode(digest.digest()).decode()}:"
    )
    assert answer.headers["etag"] == f'"{digest.hexdigest()}"'
    assert answer.read() == content
    link.close()
    (tmp_path / "none.mcap").touch()
    link, answer = begun(server, "/records/none.mcap")
    assert (answer.status, answer.headers["content-length"], answer.read()) == (200, "0", b"")
    link.close()


def test_a_ticket_downloads_its_record_only_and_returns_the_hash(
    server: Server, tmp_path: Path
) -> None:
    content = written(tmp_path, 1000)
    (tmp_path / "other.mcap").write_bytes(b"x")
    said = asked(server, "POST", "/records/run.mcap", **shown(server))
    about = json.loads(said.text)
    assert about["sha256"] == hashlib.sha256(content).hexdigest()
    assert about["bytes"] == 1000
    there = f"/records/run.mcap?ticket={about['ticket']}"
    assert asked(server, "HEAD", there).status == 200
    assert asked(server, "GET", there, sec_fetch_site="same-origin").status == 200
    assert asked(server, "GET", f"/records/other.mcap?ticket={about['ticket']}").status == 401
    assert asked(server, "GET", "/records/run.mcap?ticket=" + "A" * 43).status == 401
    assert asked(server, "POST", there).status == 401  # no session: no further ticket


@pytest.mark.parametrize(
    "name", ["nothing.mcap", "secret.txt", "..%2Frun.mcap", "link.mcap", "fifo.mcap"]
)
def test_nothing_but_plain_records_can_be_fetched(
    server: Server, tmp_path: Path, name: str
) -> None:
    (tmp_path / "secret.txt").write_text("no")
    (tmp_path / "link.mcap").symlink_to("/etc/passwd")
    os.mkfifo(tmp_path / "fifo.mcap")
    assert asked(server, "GET", f"/records/{name}", **shown(server)).status == 404


def test_a_slow_download_is_complete_and_uses_bounded_memory(
    server: Server, bare: Bare, tmp_path: Path
) -> None:
    content = written(tmp_path, 10_000_000)
    link, answer = begun(server, "/records/run.mcap")
    before, got, most = memory(), bytearray(), 0
    end = time.monotonic() + 1.5
    while time.monotonic() < end:  # 100 kB/s, while the robot could send it all
        got += answer.read(10_000)
        time.sleep(0.1)
        most = max(most, memory() - before)
    got += answer.read()
    link.close()
    assert hashlib.sha256(got).digest() == hashlib.sha256(content).digest()
    assert most < 0.5 * len(content)


@pytest.mark.slow
def test_a_slow_download_of_three_hundred_megabytes_is_complete(
    server: Server, bare: Bare, tmp_path: Path
) -> None:
    with (tmp_path / "run.mcap").open("wb") as file:
        for at in range(0, SPARSE, 10_000_000):
            file.seek(at)
            file.write(str(at).encode())
        file.truncate(SPARSE)
    link, answer = begun(server, "/records/run.mcap")
    assert answer.headers["content-length"] == str(SPARSE)
    before, most, hasher, got, began = memory(), 0, hashlib.sha256(), 0, time.monotonic()
    while data := answer.read(262_144):
        hasher.update(data)
        got += len(data)
        if time.monotonic() - began < 10.0:
            time.sleep(0.1)
        most = max(most, memory() - before)
    link.close()
    assert got == SPARSE
    with (tmp_path / "run.mcap").open("rb") as file:
        assert hasher.digest() == hashlib.file_digest(file, "sha256").digest()
    assert most < MEMORY
    print(f"\n{got / (time.monotonic() - began) / 1e6:.1f} MB/s, memory + {most / 1e6:.1f} MB")


def test_a_download_resumes_where_it_broke_off(server: Server, tmp_path: Path) -> None:
    content = written(tmp_path, 50_000)
    link, answer = begun(server, "/records/run.mcap")
    tag = answer.headers["etag"]
    first = answer.read(20_000)
    link.close()
    link, answer = begun(server, "/records/run.mcap", **{"range": "bytes=20000-", "if-range": tag})
    assert answer.status == 206
    assert answer.headers["content-range"] == "bytes 20000-49999/50000"
    assert first + answer.read() == content
    link.close()
    for asked_for, status, body in [
        ("bytes=10-19", 206, content[10:20]), ("bytes=-5", 206, content[-5:]),
        ("bytes=50000-", 416, b""), ("bytes=0-", 200, content), ("lines=1-2", 200, content),
        ("bytes=9-2", 416, b""), ("bytes=1-2,4-5", 200, content),
    ]:  # fmt: skip
        link, answer = begun(server, "/records/run.mcap", range=asked_for)
        assert answer.status == status, asked_for
        assert answer.read() == body, asked_for
        link.close()
    (tmp_path / "run.mcap").write_bytes(content[::-1])  # another record by that name
    link, answer = begun(server, "/records/run.mcap", **{"range": "bytes=9-", "if-range": tag})
    assert answer.status == 200
    assert answer.read() == content[::-1]
    link.close()


def failed(answer: http.client.HTTPResponse) -> bytes:
    """What came of a download that was seen to have failed."""
    got = bytearray()
    try:
        while data := answer.read1(65_536):
            got += data
    except ConnectionError:
        return bytes(got)
    assert answer.length, "it looks as if it were whole"
    return bytes(got)


def test_a_robot_that_dies_in_the_middle_fails_the_download(
    server: Server, bare: Bare, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(records, "PIECE_WITHIN", 1.0)
    content = written(tmp_path, 20_000_000)
    link, answer = begun(server, "/records/run.mcap")
    assert answer.status == 200
    answer.read(500_000)
    bare.die()
    assert len(failed(answer)) < len(content) - 500_000
    link.close()


@pytest.mark.slow
def test_a_record_that_changes_or_ends_too_soon_fails_the_download(
    server: Server, tmp_path: Path
) -> None:
    content = written(tmp_path, 20_000_000)
    for spoil in ("changed", "cut"):
        (tmp_path / "run.mcap").write_bytes(content)
        link, answer = begun(server, "/records/run.mcap")
        answer.read(500_000)
        with (tmp_path / "run.mcap").open("r+b") as file:
            if spoil == "cut":
                file.truncate(15_000_000)
            else:
                file.seek(15_000_000)
                file.write(b"something else")
        assert len(failed(answer)) < len(content) - 500_000
        link.close()


@pytest.mark.slow
def test_a_growing_record_is_downloaded_up_to_its_size_at_the_start(
    server: Server, tmp_path: Path
) -> None:
    content = written(tmp_path, 10_000_000)
    link, answer = begun(server, "/records/run.mcap")
    with (tmp_path / "run.mcap").open("ab") as file:
        file.write(b"more")
    assert answer.read() == content
    link.close()


@pytest.mark.slow
def test_pieces_lost_with_a_connection_are_requested_again(
    server: Server, bare: Bare, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(records, "AGAIN_AFTER", 0.5)
    content = written(tmp_path, 5_000_000)
    link, answer = begun(server, "/records/run.mcap")
    got = answer.read(200_000)
    for station in list(bare.bulk._stations):
        station.stream.socket.shutdown(socket.SHUT_RDWR)
    assert got + answer.read() == content
    link.close()


def test_a_missing_piece_is_detected(
    server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Lost, twice, or in another order: what comes is whole all the same, or has failed."""
    content = written(tmp_path, 2_000_000)
    whole, count = RecordTransfer.piece, [0]

    def skipping(self: RecordTransfer) -> Piece:
        count[0] += 1
        piece = whole(self)
        return whole(self) if count[0] == 20 and self.outstanding else piece

    monkeypatch.setattr(RecordTransfer, "piece", skipping)
    monkeypatch.setattr(records, "AGAIN_AFTER", 0.5)
    link, answer = begun(server, "/records/run.mcap")
    assert answer.read() == content
    assert count[0] > 20
    link.close()


def test_a_wrong_hash_fails_the_download(
    server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written(tmp_path, 1_000_000)
    whole = RecordTransfer.piece

    def flipped(self: RecordTransfer) -> Piece:
        piece = whole(self)
        wrong = bytes([piece.data[0] ^ 1]) + piece.data[1:] if piece.offset else piece.data
        return piece._replace(data=wrong)

    monkeypatch.setattr(RecordTransfer, "piece", flipped)
    link, answer = begun(server, "/records/run.mcap")
    assert len(failed(answer)) < 1_000_000
    link.close()


def test_a_reader_that_never_reads_is_disconnected(
    server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(records, "TAKEN_WITHIN", 0.5)
    written(tmp_path, 20_000_000)
    link, answer = begun(server, "/records/run.mcap")
    until(lambda: server.station._downloads._going == 0)
    assert len(failed(answer)) < 20_000_000
    link.close()


def test_downloads_are_limited_and_the_next_is_refused_with_the_reason(
    server: Server, tmp_path: Path
) -> None:
    written(tmp_path, 20_000_000)
    going = [begun(server, "/records/run.mcap") for _ in range(records.MOST_AT_ONCE)]
    said = asked(server, "POST", "/records/run.mcap", **shown(server))
    assert said.status == 503
    assert "wait for one" in said.text
    for link, answer in going:
        answer.close()
        link.close()
    until(lambda: server.station._downloads._going == 0, within=30.0)
    assert asked(server, "POST", "/records/run.mcap", **shown(server)).status == 200


def test_a_hash_requested_on_a_lost_connection_is_requested_again(
    server: Server, bare: Bare, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(records, "AGAIN_AFTER", 0.5)
    written(tmp_path, 1000)
    lost = [0]
    fetch = bare.bulk._fetch

    def losing(station: object, asked_for: Fetch) -> None:
        if asked_for.name and not lost[0]:
            lost[0] = 1
            return
        fetch(station, asked_for)  # type: ignore[arg-type]

    monkeypatch.setattr(bare.bulk, "_fetch", losing)
    assert asked(server, "POST", "/records/run.mcap", **shown(server)).status == 200
    assert lost[0]


def test_a_slow_download_delays_neither_pictures_nor_datagrams(
    server: Server, bare: Bare, tmp_path: Path
) -> None:
    written(tmp_path, 20_000_000)
    link, answer = begun(server, "/records/run.mcap")  # and nobody reads
    end = StationEnd(bare.keys, "127.0.0.1", bare.port)
    with end, StationBulk(bare.keys, "127.0.0.1", bare.port, end.session) as watcher:
        until(lambda: watcher.connected and end.status())
        ages, late = [], []
        for number in range(40):
            sent = time.monotonic()
            bare.bulk.publish(Picture(number, 0.0, Pose(0.0, 0.0, 0.0), os.urandom(20_000)))
            until(lambda n=number: (p := watcher.picture()) is not None and p.number == n)
            late.append(time.monotonic() - sent)
            told = end.status()
            assert told is not None
            ages.append(told.age)
        assert sorted(late)[30] < 0.2
        assert sorted(ages)[30] < 0.2
    assert answer.read(1)
    link.close()


def test_published_messages_do_not_accumulate_at_a_station_that_does_not_read(
    bare: Bare,
) -> None:
    end = StationEnd(bare.keys, "127.0.0.1", bare.port)
    with end, StationBulk(bare.keys, "127.0.0.1", bare.port, end.session) as watcher:
        until(lambda: watcher.connected)
        for number in range(200):
            bare.bulk.publish(HealthReport(number / 200.0, ()))
            time.sleep(0.005)
        until(
            lambda: any(
                isinstance(m, HealthReport) and m.battery > 0.99 for m in watcher._news.values()
            )
        )
        assert sum(isinstance(m, HealthReport) for m in watcher._news.values()) == 1


def test_a_robot_that_sends_more_than_requested_is_disconnected(bare: Bare, tmp_path: Path) -> None:
    written(tmp_path, 20_000_000)
    end = StationEnd(bare.keys, "127.0.0.1", bare.port)
    with end, StationBulk(bare.keys, "127.0.0.1", bare.port, end.session) as careless:
        until(lambda: careless.connected and end.status())
        careless.send(Fetch("run.mcap", 0, 20_000_000))
        until(lambda: careless._unread > 8_000_000, within=30.0)
        until(lambda: not careless.connected, within=30.0)
        assert sum(len(p.data) for p in careless.news() if isinstance(p, Piece)) < 17_000_000


def test_the_list_and_a_hash_are_sent_during_a_download(server: Server, tmp_path: Path) -> None:
    written(tmp_path, 20_000_000)
    link, answer = begun(server, "/records/run.mcap")
    took: list[float] = []

    def ask() -> None:
        began = time.monotonic()
        assert asked(server, "POST", "/records/run.mcap", **shown(server)).status == 200
        took.append(time.monotonic() - began)

    thread = threading.Thread(target=ask)
    thread.start()
    thread.join(20.0)
    assert took
    assert took[0] < 10.0
    assert answer.read(1)
    link.close()
