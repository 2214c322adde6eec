"""Unpaired and hostile senders change nothing during a drive."""

from __future__ import annotations

import shutil
import socket
import subprocess
import time

import pytest

from cohelm.link.dtls import Channel, HandshakeRefused, context
from cohelm.link.keys import Keys, pair_here
from cohelm.link.messages import RequestKind
from cohelm.link.robot_end import RobotEnd
from cohelm.link.station_end import StationEnd
from tests.link import fuzz
from tests.link.ends import STATUS, clients, until
from tests.link.fuzz import HERE, Attack

pytestmark = pytest.mark.xdist_group("realtime")


@pytest.fixture
def driven():
    attack = Attack(1)
    yield attack
    attack.close()
    assert not attack.wrong


def stranger(keys: Keys) -> Keys:
    """Knows the robot's certificate, has a key of its own."""
    return pair_here("stranger")[1]._replace(trusted=keys.trusted)


def test_an_unpaired_station_is_refused_and_logged_while_driving_continues(driven, caplog):
    with StationEnd(stranger(driven.keys), HERE, driven.port) as station:
        until(lambda: driven.robot._listener.counts["certificate verify failed"] >= 2)
        assert station.status() is None
        assert not station.state().connected
        until(lambda: "the robot does not accept this station (" in station.state().why)
    assert "refused 127.0.0.1: certificate verify failed" in caplog.text
    assert in_force(driven).stick == fuzz.STICK
    assert list(clients(driven.robot).values()) == ["local"]


def test_another_robot_at_the_address_is_told_from_one_that_is_silent():
    with (
        RobotEnd(pair_here()[0], HERE, 0) as robot,
        StationEnd(pair_here("other")[1], HERE, robot.address[1]) as station,
    ):
        until(lambda: "another robot answers there" in station.state().why, turn=robot.receive)
        assert "`cohelm pair`" in station.state().why


def test_a_station_with_the_right_certificate_but_another_key_is_refused(driven):
    wrong = driven.keys._replace(key=pair_here()[1].key)
    from OpenSSL import SSL

    with pytest.raises(SSL.Error):
        context(wrong, server=False)
    other = pair_here()[0]  # a robot that shows what it likes is not this station's robot
    with (
        RobotEnd(other, HERE, 0) as impostor,
        StationEnd(driven.keys, HERE, impostor.address[1]) as station,
    ):
        until(lambda: "certificate" in station.state().why)
        assert station.status() is None


def test_a_replayed_or_forged_datagram_is_dropped_silently():
    robot, keys = pair_here()
    server = Channel(context(robot, server=True), server=True)
    client = Channel(context(keys, server=False), server=False)
    client.start()
    greeted = False
    for _ in range(10):
        for datagram in client.waiting():
            if greeted:
                server.take(datagram)
            elif server.greeted(datagram, "there"):
                greeted = True
                server.start()
        for datagram in server.waiting():
            client.take(datagram)
    (one,), (two,) = client.seal(b"one"), client.seal(b"two")
    assert server.take(two) == [b"two"]
    assert server.take(one) == [b"one"]  # late is not replayed; the sequence number sees to it
    assert server.take(one) == server.take(two) == []
    for at in range(len(two)):
        forged = bytearray(client.seal(b"three")[0])
        forged[at] ^= 0x10
        assert server.take(bytes(forged)) in ([], [b"three"])  # an unused bit of the header
    assert server.take(client.seal(b"four")[0]) == [b"four"]


def in_force(driven):
    """The driver's command, within a second: a machine that tests share may be held up."""
    heard = []
    until(lambda: heard.append(driven.robot.receive().command) or heard[-1], within=1.0)
    return heard[-1]


def test_a_flood_of_hellos_and_handshakes_does_not_disturb_the_driver(driven):
    """1500 hellos from new ports, and strangers who go all the way, within a few seconds."""
    began, before = time.monotonic(), driven.ages.copy()
    made = context(stranger(driven.keys), server=False)
    counts = driven.robot._listener.counts

    def refused() -> int:
        return counts["too many handshakes"] + counts["certificate verify failed"]

    finished = 0
    for number in range(1500):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            client = Channel(made, server=False)
            client.start()
            sock.sendto(client.waiting()[0], driven.to)
            if number % 10 == 0:  # this one shows that it has its address, and goes on
                sock.settimeout(0.5)
                try:
                    for _ in range(6):
                        client.take(sock.recv(4096))
                        for datagram in client.waiting():
                            sock.sendto(datagram, driven.to)
                        finished += 1
                except (TimeoutError, HandshakeRefused):
                    pass
        took = time.monotonic() - began
        if took > 3.0 or (took > 1.5 and finished > 40 and refused() > 20):
            break
    assert finished > 20
    assert refused() > 10
    ages = sorted((driven.ages - before).elements())
    assert len(ages) > 20.0 * (time.monotonic() - began)  # of 50 a second, on a busy machine
    assert ages[int(0.95 * len(ages))] < 200  # attackers and driver share this process
    assert in_force(driven).stick == fuzz.STICK


@pytest.mark.parametrize("seconds", [2.0, pytest.param(600.0, marks=pytest.mark.slow)])
def test_all_attacks_at_once_move_nothing_and_crash_nothing(seconds):
    assert fuzz.main(seconds, seed=7 if seconds < 10.0 else int(time.time())) == []


@pytest.mark.skipif(shutil.which("openssl") is None, reason="the command `openssl` is missing")
def test_an_independent_client_connects_only_with_a_paired_key(tmp_path):
    robot_keys, keys = pair_here()

    def connects(with_keys: Keys | None, port: int) -> str:
        command = ["openssl", "s_client", "-dtls1_2", "-connect", f"{HERE}:{port}",
                   "-CAfile", str(tmp_path / "robot.pem"), "-verify_return_error"]  # fmt: skip
        (tmp_path / "robot.pem").write_bytes(keys.trusted[0])
        if with_keys is not None:
            (tmp_path / "own.pem").write_bytes(with_keys.certificate)
            (tmp_path / "own.key").write_bytes(with_keys.key)
            command += ["-cert", str(tmp_path / "own.pem"), "-key", str(tmp_path / "own.key")]
        said = ""
        with subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        ) as client:
            assert client.stdout is not None
            for line in client.stdout:  # until it has connected, or has given up
                said += line.decode(errors="replace")
                if "Verify return code" in said:
                    break
            client.communicate(b"Q\n", timeout=10)
        return said

    with RobotEnd(robot_keys, HERE, 0) as robot:
        port = robot.address[1]
        paired = connects(keys, port)
        assert "Cipher is ECDHE-ECDSA-" in paired
        assert "Verify return code: 0 (ok)" in paired
        assert not robot._listener.counts
        for unpaired, why in (
            (pair_here("other")[1], "certificate verify failed"),
            (None, "peer did not return a certificate"),
        ):
            connects(unpaired, port)
            until(lambda why=why: robot._listener.counts[why] >= 1)
        # and the protocol in it is no business of openssl's
        with StationEnd(keys, HERE, port) as station:
            until(station.status, turn=lambda: robot.send_status(STATUS))
            assert station.ask(RequestKind.TAKE)
