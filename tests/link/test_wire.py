from __future__ import annotations

import contextlib

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from cohelm.core.types import Pose, Stick
from cohelm.link import bulk_messages as b, messages as m
from cohelm.link.codec import Malformed
from cohelm.link.wire import (
    DATAGRAMS,
    LARGEST,
    Header,
    encode,
    from_operator,
    from_robot,
    largest,
)  # fmt: skip
from tests.link import examples as ex
from tests.link.ends import STATUS

HEADER = Header(7, 1, 2.0, 1.5, 0.1)
HEADER_BYTES = 34
COMMAND = m.Command(Stick(0.5, -0.25), True, True, m.Device.GAMEPAD, 0.75)
UPLINK = m.Uplink(COMMAND)
UP_AND_DOWN = [
    (ex.uplinks, from_operator, False),
    (ex.bulk_up, from_operator, True),
    (ex.datagrams_down, from_robot, False),
    (ex.bulk_down, from_robot, True),
]
READERS = [(reader, bulk) for _, reader, bulk in UP_AND_DOWN]


@pytest.mark.parametrize(("messages", "reader", "bulk"), UP_AND_DOWN)
@given(data=st.data(), header=ex.headers)
def test_messages_arrive_as_sent(data, header, messages, reader, bulk):
    message = data.draw(messages)
    assert ex.same(reader(encode(header, message), bulk), (header, message))


@given(data=st.binary(max_size=1200))
@settings(max_examples=300)
def test_no_bytes_raise_anything_but_malformed(data):
    for reader, bulk in READERS:
        for kind in (b"", *(bytes((1, k)) for k in (1, 2, 3, 4, 64, 65, 66, *range(96, 105)))):
            with contextlib.suppress(Malformed):
                reader(kind + data, bulk)


@pytest.mark.parametrize(("messages", "reader", "bulk"), UP_AND_DOWN)
@given(data=st.data())
def test_damaged_messages_are_refused_or_are_messages(data, messages, reader, bulk):
    """Whatever is accepted says the same when it is sent again."""
    whole = bytearray(encode(HEADER, data.draw(messages)))
    for _ in range(data.draw(st.integers(1, 4))):
        whole[data.draw(st.integers(0, len(whole) - 1))] = data.draw(st.integers(0, 255))
    cut = bytes(whole[: data.draw(st.integers(0, len(whole)))])
    for damaged in (bytes(whole), cut, bytes(whole) + b"\0"):
        try:
            header, message = reader(damaged, bulk)
        except Malformed:
            continue
        assert ex.same(reader(encode(header, message), bulk), (header, message))


@given(cut=st.integers(0, 10_000))
def test_truncated_messages_and_trailing_bytes_are_refused(cut):
    whole = encode(HEADER, UPLINK)
    with pytest.raises(Malformed, match="bytes"):
        from_operator(whole[: cut % len(whole)])
    with pytest.raises(Malformed, match="1 bytes too many"):
        from_operator(whole + b"x")


@pytest.mark.parametrize("of", DATAGRAMS)
def test_the_largest_datagram_passes_any_ipv6_path(of):
    assert largest(of) <= LARGEST
    assert LARGEST + 13 + 8 + 16 + 8 + 40 <= 1280  # DTLS record, nonce, tag; UDP; IPv6


def test_a_status_has_room_for_what_is_yet_to_be_said():
    assert largest(m.Status) <= LARGEST - 64


def test_too_large_messages_are_refused_before_they_are_read():
    with pytest.raises(Malformed, match="1151 bytes"):
        from_operator(bytes(LARGEST + 1))
    with pytest.raises(Malformed, match="too many"):
        from_robot(bytes(b.LARGEST_BULK + 1), bulk=True)


def test_a_count_larger_than_the_message_costs_no_memory():
    head = encode(HEADER, b.Polyline(b.LineKind.DETOUR, np.zeros((0, 2), np.float32)))[:-4]
    with pytest.raises(Malformed, match="rows"):
        from_robot(head + b"\xff\xff\xff\xff", bulk=True)
    with pytest.raises(Malformed, match="ends after"):
        from_robot(head + (99_999).to_bytes(4, "little"), bulk=True)


def test_each_direction_accepts_only_its_own_messages():
    command = encode(HEADER, UPLINK)
    health = encode(HEADER, b.HealthReport(0.5, ()))
    for data, reader, bulk in (
        (command, from_robot, False), (command, from_operator, True),
        (health, from_operator, True), (health, from_robot, False),
    ):  # fmt: skip
        with pytest.raises(Malformed, match="belong"):
            reader(data, bulk)


def test_another_protocol_version_is_reported():
    said = f"version 3 of the link's protocol, and {m.VERSION} here: install"
    with pytest.raises(Malformed, match=said):
        from_operator(b"\x03" + encode(HEADER, UPLINK)[1:])


@pytest.mark.parametrize("number", [float("nan"), float("inf"), 1.0001, -2.0])
def test_an_invalid_deflection_can_be_neither_sent_nor_received(number):
    with pytest.raises(ValueError, match="not a number in"):
        encode(HEADER, m.Uplink(COMMAND._replace(stick=Stick(number, 0.0))))
    raw = bytearray(encode(HEADER, UPLINK))
    raw[HEADER_BYTES : HEADER_BYTES + 4] = np.float32(number).tobytes()
    with pytest.raises(Malformed, match="not a number in"):
        from_operator(bytes(raw))


@pytest.mark.parametrize("number", [float("nan"), float("inf")])
def test_waypoints_must_be_finite_numbers(number):
    points = b.Waypoints(1, np.array([[0.0, number]]), False)
    with pytest.raises(ValueError, match="finite"):
        encode(HEADER, points)


def test_long_texts_are_truncated_with_an_ellipsis_and_cleaned():
    message = b.HealthReport(1.0, ("ü" * 300, "a\x1b[31mb\n"))
    got = from_robot(encode(HEADER, message), bulk=True)[1]
    assert isinstance(got, b.HealthReport)
    assert got.faults == ("ü" * 198 + "…", "a [31mb ")


def test_the_reason_of_a_stop_is_not_truncated():
    why = "scans and odometry disagree: in 0.4 s 0.12 m and 14 deg against 0.31 m and -2 deg"
    got = from_robot(encode(HEADER, STATUS._replace(stopped=why, why=why)))[1]
    assert isinstance(got, m.Status)
    assert (got.stopped, got.why) == (why, why)


@given(st.lists(st.text("aü…", min_size=1, max_size=20), min_size=20).map(" ".join))
def test_a_long_reason_ends_with_a_whole_word_and_an_ellipsis(why):
    got = from_robot(encode(HEADER, STATUS._replace(stopped=why)))[1]
    assert isinstance(got, m.Status)
    if got.stopped != why:
        shown = got.stopped.removesuffix("…")
        assert why.startswith(f"{shown} ")
        assert 60 < len(got.stopped.encode()) <= 128


def test_a_fault_and_a_name_are_not_truncated():
    """A driver's own sentence, the longest name of a station, and names not in Latin letters."""
    fault = "read failed: SerialException: could not open port /dev/serial/by-id/usb-FTDI_FT232R_"
    fault += "USB_UART_A50285BI-if00-port0: [Errno 2] No such file or directory"
    report = b.HealthReport(1.0, (fault,))
    assert from_robot(encode(HEADER, report), bulk=True)[1] == report
    lease = STATUS.lease._replace(driver_name="a" * 32, requester_name="b" * 32)
    got = from_robot(encode(HEADER, STATUS._replace(lease=lease)))[1]
    assert isinstance(got, m.Status)
    assert (got.lease.driver_name, got.lease.requester_name) == ("a" * 32, "b" * 32)
    docks = b.Docks((b.DockPlace("充" * 24, Pose(0.0, 0.0, 0.0), 1.0),))
    assert from_robot(encode(HEADER, docks), bulk=True)[1] == docks
    records = b.Records((b.RecordInfo("ä" * 125 + ".mcap", 1, 0.0),))
    assert from_robot(encode(HEADER, records), bulk=True)[1] == records


def test_a_refusal_is_not_truncated():
    """The longest so far: why a mode is refused is why the robot is stopped."""
    why = "reset first: the robot reports: scans and odometry disagree: in 0.4 s 0.12 m and 14 deg "
    why += "against 0.31 m and -2 deg; the front bumper is pressed, and the robot is driven on"
    answer = m.Answer(7, False, why)
    got = from_robot(encode(HEADER, STATUS._replace(answers=(answer,))))[1]
    assert isinstance(got, m.Status)
    assert got.answers == (answer,)
    checked = b.Checked(answer, 3)
    assert from_robot(encode(HEADER, checked), bulk=True)[1] == checked


def test_of_too_many_items_the_first_are_sent():
    rows = np.arange(300, dtype=np.float32).reshape(50, 6)
    got = from_robot(encode(HEADER, m.Discs(1, rows)))[1]
    assert ex.same(got, m.Discs(1, rows[:40]))
