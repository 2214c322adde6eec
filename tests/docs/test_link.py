"""docs/link.md says what the code does."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from cohelm.core.types import Stick
from cohelm.link import client, lease, operator, pending, robot_end, station_end, wire
from cohelm.link.messages import Command, Device, Request, RequestKind, Uplink
from cohelm.link.sticks.feel import SLOWNESS
from cohelm.loop.stick import BACK_WITHIN, CENTRED_WITHIN, ArmingParams

PAGE = Path(__file__).parents[2] / "docs" / "link.md"
TEXT = PAGE.read_text(encoding="utf-8")


def test_the_bytes_of_a_command_are_where_the_page_documents():
    command = Uplink(
        Command(Stick(0.5, -0.5), True, False, Device.TOUCH, 0.75),
        (Request(7, RequestKind.MODE, 2, 1.5),),
    )
    data = wire.encode(wire.Header(0x0102030405060708, 9, 2.5, 1.5, 0.25), command)
    rows = dict(re.findall(r"^\| (\d+) \| (?:u8|u32|u64|f|d) \| (.+?) \|$", TEXT, re.MULTILINE))
    import struct

    expected = {"0": wire.VERSION, "1": 1, "2": 0x0102030405060708, "10": 9, "14": 2.5, "22": 1.5,
                "30": 0.25, "34": 0.5, "38": -0.5, "42": 1, "43": 0, "44": 3, "45": 0.75,
                "49": 1}  # fmt: skip
    forms = {"u8": "B", "u32": "I", "u64": "Q", "f": "f", "d": "d"}
    assert set(rows) == set(expected)
    for at, value in expected.items():
        (kind,) = re.findall(rf"^\| {at} \| (u8|u32|u64|f|d) \|", TEXT, re.MULTILINE)
        assert struct.unpack_from("<" + forms[kind], data, int(at)) == (value,)
    assert struct.unpack_from("<IBHd", data, 50) == (7, RequestKind.MODE, 2, 1.5)
    assert len(data) == 50 + 15


@pytest.mark.parametrize("ask", RequestKind)
def test_every_request_is_on_the_page(ask):
    assert f"| {ask.name} {ask.value} |" in TEXT


def test_the_numbers_are_those_of_the_code():
    for said, value in {
        "an age of | 250 ms": operator.STALE,
        "commands for | 250 ms": ArmingParams().stale,
        "`steer` for 100 ms": station_end.FRESH,
        "longer ago than | 1 s": robot_end.REQUEST_LIFE,
        "without asking | 2 s": robot_end.TAKEOVER_AFTER,
        "is forgotten | 30 s": robot_end.CLIENT_TIMEOUT,
        "for the lease | 10 s": lease.ANSWER_WITHIN,
    }.items():
        assert said in TEXT
        number, unit = re.findall(r"([\d.]+) (ms|s)\b", said)[-1]
        assert float(number) * {"ms": 1e-3, "s": 1.0}[unit] == pytest.approx(value)
    assert f"clients | {client.MAX_CLIENTS}, of them {client.MAX_CLIENTS_PER_KEY} with" in TEXT
    assert (
        f"{client.DATAGRAMS:.0f} a second and {client.DATAGRAM_BURST:.0f} at once are heard" in TEXT
    )
    assert f"of {client.DECRYPTED:.0f} a second a stop is" in TEXT
    assert f"{client.REQUESTS:.0f} a second and {client.REQUEST_BURST:.0f} at once" in TEXT
    assert f"{pending.MOST_WAITING} wait for the loop" in TEXT
    sticks = (PAGE.parent / "sticks.md").read_text(encoding="utf-8")
    assert f"constant of {1000.0 * SLOWNESS:.0f} ms" in sticks
    loop = (PAGE.parent / "loop.md").read_text(encoding="utf-8")
    assert f"again within {BACK_WITHIN:.0f} s of the last before" in loop
    assert f"seen centred within {CENTRED_WITHIN:.0f} s from there" in loop
