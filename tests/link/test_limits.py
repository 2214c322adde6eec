"""Limits of one client: slots, client numbers, datagrams and requests; a stop always counts."""

from __future__ import annotations

import contextlib
import itertools
import math
import socket
import time

import pytest
from hypothesis import given, settings, strategies as st

from cohelm.core.types import Stick
from cohelm.link.client import (
    DATAGRAM_BURST,
    MAX_CLIENTS,
    MAX_CLIENTS_PER_KEY,
    free_number,
)
from cohelm.link.dtls import Channel, HandshakeRefused, context
from cohelm.link.keys import Keys, pair_here
from cohelm.link.lease import LeaseState
from cohelm.link.messages import Command, Device, Request, RequestKind, Uplink
from cohelm.link.pending import MOST_WAITING
from cohelm.link.robot_end import TAKEOVER_AFTER, RobotEnd
from cohelm.link.station_end import StationEnd
from cohelm.link.wire import Header, encode, from_operator, may_stop
from tests.link.ends import CENTRED, STATUS, answered, clients, until

pytestmark = pytest.mark.xdist_group("realtime")
HERE = "127.0.0.1"


@pytest.fixture(scope="module")
def keys() -> tuple[Keys, Keys]:
    return pair_here()


@pytest.fixture
def robot(keys):
    with RobotEnd(keys[0], HERE, 0) as robot:
        yield robot


def command(number: int, *requests: Request, session: int = 7) -> bytes:
    now = time.monotonic()
    stick = Uplink(Command(CENTRED, True, True, Device.SCRIPT), requests)
    return encode(Header(session, number, now, now - 1e-3, 1e-3), stick)


class Raw:
    """A paired station that says exactly what it is told."""

    def __init__(self, robot: RobotEnd, keys: Keys) -> None:
        self.sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.sock.settimeout(1.0)
        self.sock.connect((HERE, robot.address[1]))
        self.channel = Channel(context(keys, server=False), server=False)
        self.channel.start()
        while not self.channel.up:
            for datagram in self.channel.waiting():
                self.sock.send(datagram)
            self.channel.take(self.sock.recv(4096))

    def close(self) -> None:
        self.sock.close()

    def say(self, data: bytes) -> None:
        for datagram in self.channel.seal(data):
            self.sock.send(datagram)


@pytest.fixture
def raw(robot, keys):
    """Makes paired stations, and lets go of them."""
    with contextlib.ExitStack() as stack:
        yield lambda end=robot, key=keys[1]: stack.enter_context(contextlib.closing(Raw(end, key)))


requests = st.builds(
    Request, st.integers(1, 2**32 - 1), st.sampled_from(list(RequestKind)), st.integers(0, 65535),
    st.floats(0.0, 1e6),
)  # fmt: skip


@given(st.lists(requests, max_size=8))
def test_a_stop_in_any_command_is_found(asked):
    data = command(1, *asked)
    assert may_stop(data) is any(r.what is RequestKind.STOP for r in asked)
    assert from_operator(data)[1].requests == tuple(asked)


@given(st.binary(max_size=1200))
@settings(max_examples=300)
def test_looking_for_a_stop_accepts_any_bytes(data):
    assert may_stop(data) in (True, False)
    assert may_stop(b"\x01\x01" + data) in (True, False)


def test_a_stop_passes_from_a_client_over_its_rate_limit(robot, raw):
    raw = raw()
    for number in range(1, int(DATAGRAM_BURST) + 200):
        raw.say(command(number))
        if number % 50 == 0:
            time.sleep(0.01)
    until(lambda: robot.counts["too many"] > 20)
    raw.say(command(5000, Request(1, RequestKind.MODE, 2, time.monotonic()),
                    Request(2, RequestKind.STOP, 0, time.monotonic())))  # fmt: skip
    asked = []
    until(lambda: asked.extend(robot.receive().requests) or asked, within=1.0)
    assert [a.request.what for a in asked] == [RequestKind.STOP]
    assert asked[0].name == "local (1)"


def test_requests_beyond_a_rate_are_refused_with_an_answer_and_stops_are_not(robot, raw):
    raw, answers = raw(), []
    robot.answer = lambda *answer: answers.append(answer)
    numbers = itertools.count(1)
    for k in range(1, 12):
        now = time.monotonic()
        asked = [Request(next(numbers), RequestKind.ACKNOWLEDGE, 0, now) for _ in range(8)]
        raw.say(command(k, *asked))
    until(lambda: len(answers) >= 88 - MOST_WAITING)
    raw.say(command(12, Request(next(numbers), RequestKind.STOP, 0, time.monotonic())))
    until(lambda: robot._pending._stops)
    done = robot.receive().requests
    assert done[0].request.what is RequestKind.STOP
    assert len(done) <= MOST_WAITING + 1
    refused = [answer for answer in answers if answer[3:] and "too many requests" in answer[3]]
    assert len(refused) + len(done) == 88 + 1


def test_a_request_from_before_a_station_slept_is_refused_after_it(robot, raw):
    """Its clock stood still meanwhile, so by that the request is as new as it was."""
    raw, answers, asleep = raw(), [], 5.0
    robot.answer = lambda *answer: answers.append(answer)

    def say(number: int, behind: float, *requests: Request) -> None:
        now = time.monotonic()  # the robot's, too
        stick = Uplink(Command(CENTRED, True, True, Device.SCRIPT), requests)
        raw.say(encode(Header(7, number, now - behind, now - 1e-3, 1e-3), stick))

    say(1, 0.0)
    say(2, 0.0, Request(1, RequestKind.TAKE, 0, time.monotonic()))
    until(lambda: answers)
    pressed = Request(2, RequestKind.MODE, 2, time.monotonic() - asleep - 0.1)
    for number in range(3, 6):
        say(number, asleep, pressed)
    until(lambda: len(answers) > 1)
    assert answers[1][1:] == (2, False, "the request is too old")
    assert robot.receive().requests == ()
    say(6, asleep, Request(3, RequestKind.MODE, 2, time.monotonic() - asleep))
    asked = []
    until(lambda: asked.extend(robot.receive().requests) or asked)
    assert asked[0].request.number == 3


def test_the_lease_is_not_handed_to_a_client_that_fell_silent(robot, raw, monkeypatch):
    """The robot would hold for somebody who is not there."""
    monkeypatch.setattr("cohelm.link.lease.ANSWER_WITHIN", 1.0)
    monkeypatch.setattr("cohelm.link.robot_end.TAKEOVER_AFTER", 0.5)
    driver, other, numbers = raw(), raw(), itertools.count(1)

    def say(who: Raw, session: int) -> None:
        k = next(numbers)
        who.say(command(k, Request(k, RequestKind.TAKE, 0, time.monotonic()), session=session))

    until(lambda: robot.driver, turn=lambda: (say(driver, 1), time.sleep(0.05)))
    held = robot.driver
    until(lambda: robot._held.requester, turn=lambda: (say(other, 2), time.sleep(0.05)))
    end = time.monotonic() + 1.6
    while time.monotonic() < end:
        driver.say(command(next(numbers), session=1))
        time.sleep(0.05)
    assert robot._held == LeaseState(held)


def test_of_a_driver_that_is_not_heard_any_more_the_others_are_told(robot, keys, raw, monkeypatch):
    """A station that was started again read that it drives itself, before it died."""
    monkeypatch.setattr("cohelm.link.robot_end.TAKEOVER_AFTER", 0.5)
    driver, numbers = raw(), itertools.count(1)

    def say() -> None:
        k = next(numbers)
        driver.say(command(k, Request(k, RequestKind.TAKE, 0, time.monotonic()), session=1))
        time.sleep(0.05)

    with StationEnd(keys[1], HERE, robot.address[1]) as other:

        def left(*turns) -> float:
            for turn in (lambda: robot.send_status(STATUS), *turns):
                turn()
            told = other.status()
            return math.nan if told is None else told.message.lease.left

        until(lambda: robot.driver and other.status(), turn=lambda: (say(), left()))
        for _ in range(5):
            assert math.isnan(left(say))
        until(lambda: left() == 0.0)  # the driver is silent now
        assert robot.driver


def test_client_numbers_are_reused_and_new_clients_get_a_status(robot, keys):
    """After 65 535 connections, as if there had been so many."""
    robot._clients.last = 65_533
    with contextlib.ExitStack() as stack:
        stations = [
            stack.enter_context(StationEnd(keys[1], HERE, robot.address[1])) for _ in range(4)
        ]
        until(lambda: all(s.status() for s in stations), turn=lambda: robot.send_status(STATUS))
        assert {s.status().message.lease.you for s in stations} == {65_534, 65_535, 1, 2}


@given(st.integers(0, 65_535), st.sets(st.integers(1, 65_535), max_size=30))
def test_a_client_number_is_free_fits_two_bytes_and_is_reused_late(last, taken):
    number = free_number(last, taken)
    assert 1 <= number <= 65_535
    assert number not in taken
    if not taken:
        assert number == last % 65_535 + 1


def test_one_station_can_not_use_all_client_slots_or_displace_the_driver(keys, raw):
    robot_keys, first = keys
    _, second = pair_here("second")
    trusted = robot_keys._replace(trusted=(*robot_keys.trusted, second.certificate))
    second = second._replace(trusted=first.trusted)
    with RobotEnd(trusted, HERE, 0) as robot, StationEnd(first, HERE, robot.address[1]) as driver:
        until(driver.status, turn=lambda: robot.send_status(STATUS))
        answered(driver, RequestKind.TAKE, turn=lambda: robot.send_status(STATUS))
        raws = []
        for k in range(MAX_CLIENTS_PER_KEY + 3):
            raws.append(raw(robot))
            raws[-1].say(command(1, session=100 + k))

        def speak() -> None:
            robot.send_status(STATUS)
            for k, one in enumerate(raws):
                with contextlib.suppress(HandshakeRefused):
                    one.say(command(int(1e4 * time.monotonic()) % 2**31, session=100 + k))
            time.sleep(0.05)

        until(lambda: robot._listener.counts["too many clients"] >= 3, turn=speak)
        assert len(clients(robot)) == MAX_CLIENTS_PER_KEY
        with StationEnd(second, HERE, robot.address[1]) as other:
            until(other.status, turn=speak)
            assert len(clients(robot)) == MAX_CLIENTS_PER_KEY + 1 <= MAX_CLIENTS
            assert robot.driver == driver.status().message.lease.you
            # who falls silent makes room, but never the driver
            with StationEnd(first, HERE, robot.address[1]) as late:
                until(
                    late.status, within=TAKEOVER_AFTER + 8.0, turn=lambda: robot.send_status(STATUS)
                )
            assert robot.driver in clients(robot)


def test_a_driver_reconnects_on_a_new_channel_though_all_client_slots_are_taken(robot, raw):
    first = raw()
    first.say(command(1, Request(1, RequestKind.TAKE, 0, time.monotonic()), session=1))
    until(lambda: robot.driver)
    for k in range(MAX_CLIENTS_PER_KEY - 1):
        raw().say(command(1, session=100 + k))
    until(lambda: len(clients(robot)) == MAX_CLIENTS_PER_KEY)
    again = raw()  # the same person, from another network
    again.say(command(2, session=1))
    again.say(command(3, Request(2, RequestKind.STOP, 0, time.monotonic()), session=1))
    asked = []
    until(lambda: asked.extend(robot.receive().requests) or asked)
    assert asked[0].client == robot.driver
    until(lambda: robot.receive().command)
    assert robot.receive().command.stick == Stick(0.0, 0.0)


def test_a_client_that_reconnects_and_leaves_in_one_breath_leaves_the_robot_listening(robot, raw):
    first = raw()
    first.say(command(1, session=1))
    until(lambda: clients(robot))
    again = raw()
    until(lambda: len(robot._clients) == 2)
    with robot._lock:  # the robot's end reads what comes now in one turn
        robot._waker.wake()
        time.sleep(0.1)
        again.say(command(2, session=1))
        for datagram in again.channel.close():
            again.sock.send(datagram)
    until(lambda: not robot._clients)
    other = raw()
    other.say(command(1, Request(1, RequestKind.TAKE, 0, time.monotonic()), session=2))
    until(lambda: robot.driver)
    assert not robot.counts["mistakes of the link"]
