"""Brunner stick over CLS2Sim: requests, answers, forces."""

from __future__ import annotations

import math
import signal
import socket
import struct
import subprocess
import sys
import time
from itertools import pairwise

import pytest
from hypothesis import given, strategies as st

from cohelm.core.errors import CohelmError
from cohelm.core.types import CENTRED, Stick
from cohelm.link.sticks import trial
from cohelm.link.sticks.brunner_stick import BrunnerStick, parameters
from cohelm.link.sticks.cls2sim import Cls2SimLine, Forces, positions, request, unit
from cohelm.link.sticks.feel import returning
from cohelm.link.sticks.force import NO_FORCE, ForceRules, Swings, changed, wanted
from cohelm.link.sticks.port import Feel
from tests.few import first
from tests.link.ends import until
from tests.link.sticks.cls2sim import (
    Axis,
    CLS2SimServer,
    NoWatchdog,
    SimulatedLine,
    SimulatedStick,
)

pytestmark = pytest.mark.xdist_group("sticks")
RULES = ForceRules()
SPRING = Feel(0.5, CENTRED)
numbers = st.floats(allow_nan=True, allow_infinity=True)
sticks = st.builds(Stick, numbers, numbers)


class Bench:
    """Stick, network and device in simulated time."""

    def __init__(self, url="brunner://h?force=1000", stick=None, **network) -> None:
        self.stick = stick or SimulatedStick()
        self.line = SimulatedLine(self.stick, **network)
        self.device = BrunnerStick(
            parameters(url), self.line, NoWatchdog(), self.line.clock, self.line.wait
        )

    def run(self, seconds: float, feel: Feel = SPRING):
        """As the helm does it, every 10 ms; the last reading."""
        for _ in range(round(seconds / 0.01)):
            self.line.wait(0.01)
            reading = self.device.read()
            self.device.feel(feel)
        return reading

    def force(self) -> Forces:
        return self.line.asked[-1]


def test_a_request_is_as_documented():
    # Int32 0xAF, then Int32[4]: elevator, aileron, rudder, collective; little-endian
    assert request(Forces(258, -2)) == bytes.fromhex("af000000 02010000 feffffff 00000000 00000000")


def test_an_answer_is_as_documented():
    # Int32 0xAF, then Float[4] in 0 ... 1
    data = bytes.fromhex("af000000 0000003f 0000803e 00000000 0000803f")
    assert positions(data) == (0.5, 0.25)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        struct.pack("<i3f", 0xAF, 0.5, 0.5, 0.5),
        struct.pack("<i5f", 0xAF, 0.5, 0.5, 0.5, 0.5, 0.5),
        struct.pack("<i4f", 0xAE, 0.5, 0.5, 0.5, 0.5),
        struct.pack(">i4f", 0xAF, 0.5, 0.5, 0.5, 0.5),
        struct.pack("<i4f", 0xAF, math.nan, 0.5, 0.5, 0.5),
        struct.pack("<i4f", 0xAF, 0.5, math.inf, 0.5, 0.5),
        struct.pack("<i4f", 0xAF, -0.01, 0.5, 0.5, 0.5),
        struct.pack("<i4f", 0xAF, 0.5, 1.01, 0.5, 0.5),
    ],
)
def test_invalid_answers_are_refused(data):
    assert positions(data) is None


@given(
    st.binary(max_size=24) | st.binary(min_size=16, max_size=16).map(lambda b: b"\xaf\0\0\0" + b)
)
def test_any_datagram_gives_a_position_or_is_ignored(data):
    found = positions(data)
    assert found is None or all(0.0 <= axis <= 1.0 for axis in found)


@given(numbers, st.floats(-10000.0, 10000.0))
def test_no_force_beyond_the_maximum_is_sent(share, full):
    assert abs(unit(share, full)) <= round(abs(full))


@given(sticks, sticks, st.builds(Feel, numbers, sticks), st.floats(0.0, 1.0))
def test_the_requested_force_is_bounded_for_any_input(stick, rate, feel, damping):
    assert all(-1.0 <= axis <= 1.0 for axis in wanted(stick, rate, feel, damping))


@given(st.lists(st.tuples(sticks, numbers, numbers), max_size=20))
def test_the_force_changes_at_a_bounded_rate_for_any_answers(steps):
    force = NO_FORCE
    for wish, age, dt in steps:
        after = changed(force, Stick(*(max(-1.0, min(1.0, w)) if w == w else 0.0 for w in wish)),
                        age, dt, RULES)  # fmt: skip
        assert 0.0 <= after.risen <= 1.0
        for was, is_ in zip(force.share, after.share, strict=True):
            assert -1.0 <= is_ <= 1.0
            assert is_ == 0.0 or abs(is_ - was) <= RULES.steepest * dt + 1e-12
        force = after


def test_the_spring_is_that_of_equation_35():
    """f = k_s x towards the centre, on each axis; k_s = 10 is all the force at the end."""
    for x, psi in ((0.0, 0.0), (0.2, -0.4), (1.0, 0.6), (-0.7, -1.0)):
        for k_s in (0.0, 2.5, 5.0, 10.0):
            bench = Bench("brunner://h?force=2000,1600&damping=0")
            bench.stick.hold(Stick(x, psi))
            bench.run(2.5, Feel(k_s / 10.0, CENTRED))
            expected = (-k_s * x * 200.0, -k_s * psi * 160.0)  # [unit], from (35) alone
            assert bench.force() == pytest.approx(expected, abs=1.0)


@pytest.mark.parametrize(("forward", "left"), [(1, 1), (0, 1), (1, 0), (0, 0)])
@pytest.mark.parametrize(("elevator", "aileron"), [(1, 1), (-1, 1), (1, -1), (-1, -1)])
def test_a_released_stick_returns_to_the_centre_with_any_signs(forward, left, elevator, aileron):
    stick = SimulatedStick(Axis(unit=0.001 * elevator), Axis(unit=0.001 * aileron), forward, left)
    bench = Bench(
        f"brunner://h?force={1000 * elevator},{1000 * aileron}&forward={forward}&left={left}", stick
    )
    stick.hold(Stick(0.8, -0.6))
    assert bench.run(2.5).stick == pytest.approx((0.8, -0.6))
    stick.hold(None)
    assert bench.run(1.5).stick == pytest.approx((0.0, 0.0), abs=0.05)


def test_the_cue_is_felt_by_a_hand_and_bounded_with_the_spring():
    bench = Bench("brunner://h?force=1000&damping=0")
    bench.stick.hold(Stick(0.2, 0.0))
    bench.run(2.5)
    bench.run(0.5, Feel(0.5, Stick(-0.2, 0.1)))
    assert bench.force() == pytest.approx((-100 - 200, 100), abs=1)
    bench.stick.hold(Stick(1.0, -1.0))
    bench.run(0.5, Feel(1.0, Stick(-0.4, 0.4)))
    assert bench.force() == pytest.approx((-1000, 1000), abs=1)


@pytest.mark.parametrize("delay", [0.001, 0.02])
@pytest.mark.parametrize("push", [Stick(-0.4, 0.4), Stick(0.4, 0.0)])
def test_a_released_stick_returns_to_the_centre_against_any_cue(delay, push):
    bench = Bench(delay=delay, stick=SimulatedStick(Axis(mass=0.03), Axis(mass=0.03)))
    bench.stick.hold(Stick(0.8, 0.1))
    bench.run(2.5)
    bench.stick.hold(None)
    for _ in range(250):
        bench.run(0.01, Feel(0.5, returning(push, bench.device.read().stick, 0.5)))
    assert bench.device.read().stick == pytest.approx((0.0, 0.0), abs=0.05)


def test_the_force_starts_at_zero():
    bench = Bench("brunner://h?force=1000&damping=0")
    bench.stick.hold(Stick(1.0, 1.0))
    bench.run(2.5, Feel(1.0, CENTRED))
    felt = [abs(forces.elevator) for forces in bench.line.asked]
    assert felt[0] == 0
    assert max(b - a for a, b in pairwise(felt)) <= 11  # 1000 in 2 s
    assert felt[-1] == 1000


def test_a_suddenly_deflected_stick_gets_no_force_jump():
    bench = Bench("brunner://h?force=1000&damping=0")
    bench.run(3.0, Feel(1.0, CENTRED))
    bench.stick.hold(Stick(1.0, 0.0))
    bench.run(0.3, Feel(1.0, CENTRED))
    felt = [abs(forces.elevator) for forces in bench.line.asked]
    assert max(b - a for a, b in pairwise(felt)) <= 201  # 20 a second
    assert felt[-1] == 1000


@pytest.mark.parametrize("delay", first([0.02, 0.001, 0.005, 0.01], 2))
@pytest.mark.parametrize("loss", [0.0, 0.1])
@pytest.mark.parametrize(("mass", "friction"), [(0.03, 0.15), (0.015, 0.05)])
def test_delay_and_loss_cause_no_oscillation(delay, loss, mass, friction):
    axes = (Axis(mass=mass, friction=friction), Axis(mass=mass, friction=friction))
    bench = Bench(stick=SimulatedStick(*axes), delay=delay, loss=loss, seed=7)
    bench.stick.hold(Stick(1.0, -1.0))
    bench.run(2.5)
    bench.stick.hold(None)
    assert bench.run(2.0).valid
    assert bench.stick.stick == pytest.approx((0.0, 0.0), abs=0.05)


def test_a_stick_that_oscillates_is_lost_with_the_reason():
    axes = (Axis(mass=0.01, friction=0.0), Axis(mass=0.01, friction=0.0))
    bench = Bench("brunner://h?force=4000&damping=0", SimulatedStick(*axes), delay=0.03)
    bench.stick.hold(Stick(0.5, 0.0))
    bench.run(2.5)
    bench.stick.hold(None)
    reading = bench.run(6.0)
    assert not reading.valid
    assert "swings by itself" in reading.why
    assert bench.force() == Forces(0, 0)


def test_a_hand_that_moves_to_and_fro_is_not_taken_for_an_oscillation():
    swings = Swings()
    for step in range(1000):
        now = step * 0.01
        assert not swings.too_many(Stick(0.2, math.sin(2.0 * math.pi * 0.9 * now)), now)


def test_a_silent_stick_is_lost_within_its_timeout_and_without_force():
    bench = Bench()
    bench.stick.hold(Stick(0.5, 0.5))
    bench.run(2.5)
    assert bench.force() != Forces(0, 0)
    bench.line.dead, began = True, bench.line.now
    while bench.run(0.01).valid:
        pass
    assert bench.line.now - began == pytest.approx(0.25, abs=0.03)
    assert bench.force() == Forces(0, 0)
    reading = bench.device.read()
    assert reading.stick == CENTRED
    assert "does not answer" in reading.why
    bench.line.dead = False
    assert not bench.run(1.0).valid  # it does not come back by itself


def test_the_force_fades_while_the_position_is_unknown():
    bench = Bench("brunner://h?force=1000&silence_ms=500")
    bench.stick.hold(Stick(1.0, 0.0))
    bench.run(2.5)
    bench.line.dead = True
    bench.run(0.08)
    assert bench.force().elevator == pytest.approx(-500, abs=10)
    bench.run(0.1)
    assert -400 < bench.force().elevator < -100
    assert bench.run(0.1).valid
    assert bench.force() == Forces(0, 0)


def test_after_a_pause_of_the_process_the_force_starts_at_zero():
    bench = Bench()
    bench.stick.hold(Stick(0.5, 0.5))
    bench.run(2.5)
    bench.stick.hold(Stick(-0.25, 0.0))
    bench.line.wait(3.0)
    reading = bench.device.read()
    assert reading.valid
    assert reading.stick == pytest.approx((-0.25, 0.0))
    bench.device.feel(SPRING)
    assert bench.force() == Forces(0, 0)
    bench.run(2.5)
    assert bench.force() == pytest.approx((125, 0), abs=1)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("brunner://", "no force stick"),
        ("brunner://h:99999?force=1", "no force stick"),
        ("brunner://h/axis?force=1", "no force stick"),
        ("brunner://h", "has no default"),
        ("brunner://h?force=", "force: must be in"),
        ("brunner://h?force=nan", "force: must be in"),
        ("brunner://h?force=20000", "force: must be in -10000 ... 10000, got '20000'"),
        ("brunner://h?force=1,2,3", "one number, or two"),
        ("brunner://h?force=1&forwards=0", "did you mean forward?"),
        ("brunner://h?force=1&forward=-1", "forward: must be 0 or 1"),
        ("brunner://h?force=1&force=2", "twice"),
        ("brunner://h?force=1&damping=2", "damping: must be in"),
        ("brunner://h?force=1&silence_ms=5", "silence_ms: must be in"),
    ],
)
def test_errors_in_the_address_are_reported(text, said):
    with pytest.raises(CohelmError, match=r".") as refused:
        parameters(text)
    assert said in str(refused.value)


def test_one_force_applies_to_both_axes_and_is_the_only_required_parameter():
    params = parameters("brunner://10.0.0.5?force=300")
    assert params.force == (300.0, 300.0)
    assert (params.host, params.port, params.forward, params.left) == ("10.0.0.5", 15090, 1, 1)
    assert parameters("brunner://[::1]:7?force=-5,6").force == (-5.0, 6.0)


@pytest.mark.parametrize("delay", [0.0, 0.004, 0.02])
def test_a_deflection_arrives_with_the_first_answer_that_contains_it(delay):
    bench = Bench(delay=delay)
    bench.run(0.5)
    bench.stick.hold(Stick(0.6, -0.3))
    moved = bench.line.now
    while bench.device.read().stick != pytest.approx((0.6, -0.3)):
        bench.run(0.01)
    assert bench.line.now - moved <= 2.0 * delay + 0.021  # a period until it is asked, one to look


# ---- over UDP


@pytest.fixture
def server():
    server = CLS2SimServer()
    yield server
    server.close()


def opened(server: CLS2SimServer, more: str = "") -> BrunnerStick:
    return BrunnerStick(parameters(f"{server.url}?force=500{more}"))


def turned(device: BrunnerStick) -> None:
    device.read()
    device.feel(SPRING)


def test_an_address_without_answer_is_reported_at_once(monkeypatch):
    monkeypatch.setattr("cohelm.link.sticks.brunner_stick._PATIENCE", 0.1)
    with pytest.raises(CohelmError, match="CLS2Sim does not answer"):
        BrunnerStick(parameters("brunner://127.0.0.1:9?force=1"))


def test_a_device_that_answers_without_low_level_control_is_recognized(server, monkeypatch):
    monkeypatch.setattr("cohelm.link.sticks.brunner_stick._PATIENCE", 0.1)
    server.mangle = lambda answer: [b"\x03\0\x04"]  # a status, as protocol v2 sends
    with pytest.raises(CohelmError, match="Low level control"):
        opened(server)


@pytest.mark.parametrize(
    "mangle",
    first(
        [
            lambda answer: [],
            lambda answer: [answer[:12]],
            lambda answer: [answer[:4] + struct.pack("<f", math.nan) + answer[8:]],
            lambda answer: [answer + answer],
            lambda answer: [b"\xae" + answer[1:]],
            lambda answer: [answer[:4] + struct.pack("<f", 7.0) + answer[8:]],
        ],
        3,
    ),
)
def test_garbage_counts_as_silence(server, mangle):
    device = opened(server)
    turned(device)
    server.mangle = mangle
    until(lambda: not device.read().valid, 2.0, lambda: turned(device))
    assert server.forces[-1][1:] == (0, 0)
    device.close()


def test_answers_without_a_request_are_ignored(server):
    line = Cls2SimLine("127.0.0.1", server.port, 10.0)
    line.ask(Forces(0, 0), time.monotonic())
    until(lambda: line.answers(time.monotonic()), 2.0)
    for _ in range(10):  # duplicates and strays: more answers than requests
        server.inject(struct.pack("<i4f", 0xAF, 0.0, 0.0, 0.5, 0.5))
    time.sleep(0.02)
    assert line.answers(time.monotonic()) == []
    line.close()


def test_a_late_answer_is_ignored(server):
    server.delay = 0.1
    line = Cls2SimLine("127.0.0.1", server.port, 0.05)
    line.ask(Forces(0, 0), time.monotonic())
    time.sleep(0.25)
    assert line.answers(time.monotonic()) == []
    line.close()


def test_answers_from_another_address_are_ignored(server):
    device = opened(server)
    stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    lie = struct.pack("<i4f", 0xAF, 1.0, 1.0, 0.5, 0.5)
    server.mangle = lambda answer: []
    for _ in range(5):
        turned(device)
        stranger.sendto(lie, server.client)
        time.sleep(0.01)
        assert device.read().stick == pytest.approx((0.0, 0.0), abs=0.01)
    stranger.close()
    device.close()


def test_it_is_closed_without_force(server):
    device = opened(server)
    server.stick.hold(Stick(0.8, 0.8))
    until(lambda: server.forces[-1][1] < -20, 3.0, lambda: turned(device))
    device.close()
    until(lambda: [forces[1:] for forces in server.forces[-3:]] == [(0, 0)] * 3, 2.0)


PUSHING = """
import sys, time
from cohelm.core.errors import CohelmError
from cohelm.link.sticks.brunner_stick import BrunnerStick, parameters
from cohelm.core.types import CENTRED
from cohelm.link.sticks.port import Feel
device = None
while device is None:  # who answers is a thread of the test, and may be late on a busy machine
    try:
        device = BrunnerStick(parameters(sys.argv[1]))
    except CohelmError:
        pass
while True:
    device.read()
    device.feel(Feel(1.0, CENTRED))
    time.sleep(0.01)
"""


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, signal.SIGSTOP])
def test_the_force_is_removed_when_the_process_dies_or_hangs(server, how):
    server.stick.hold(Stick(0.9, 0.9))
    program = subprocess.Popen([sys.executable, "-c", PUSHING, f"{server.url}?force=500"])
    try:
        until(lambda: server.forces and server.forces[-1][1] < -20, 20.0)
        program.send_signal(how)
        until(lambda: server.forces[-1][1:] == (0, 0), 3.0)
    finally:
        program.kill()
        program.wait()


def test_without_its_watchdog_no_force_is_applied(server):
    device = opened(server)
    turned(device)
    device._watchdog._program.kill()
    until(lambda: not device.read().valid, 2.0, lambda: turned(device))
    assert "has ended" in device.read().why
    until(lambda: server.forces[-1][1:] == (0, 0), 1.0)
    device.close()


# ---- finding the signs out


class Helped:
    """A person who does what the trial says."""

    def __init__(self, stick: SimulatedStick, **network) -> None:
        self.stick = stick
        self.line = SimulatedLine(stick, **network)
        self.said: list[str] = []

    def say(self, text: str) -> None:
        self.said.append(text)
        if "forward" in text:
            self.stick.hold(Stick(1.0, 0.1))
        elif "left" in text and "hold it" in text:
            self.stick.hold(Stick(0.1, 1.0))
        elif "middle" in text:
            self.stick.hold(CENTRED if "hold the stick" in text else None)
            for axis in (self.stick.elevator, self.stick.aileron):
                axis.position, axis.rate = 0.5, 0.0

    def run(self) -> str:
        return trial.run(
            "brunner://h", 500.0, self.say, self.line, NoWatchdog(), self.line.clock, self.line.wait
        )


@pytest.mark.parametrize(
    ("elevator", "aileron", "forward", "left"), [(1, 1, 1, 1), (-1, 1, 0, 1), (1, -1, 1, 0)]
)
def test_the_trial_finds_the_signs_and_moves_the_stick_little(elevator, aileron, forward, left):
    stick = SimulatedStick(
        Axis(unit=0.0002 * elevator, friction=0.3), Axis(unit=0.0002 * aileron, friction=0.3),
        forward, left,
    )  # fmt: skip
    helped = Helped(stick, delay=0.002)
    found = parameters(helped.run())
    assert (found.forward, found.left) == (forward, left)
    assert [math.copysign(1, force) for force in found.force] == [elevator, aileron]
    assert helped.line.asked[-1] == Forces(0, 0)
    assert max(map(abs, stick.stick)) < 0.3


def test_a_stick_that_has_fallen_over_does_not_count_as_held():
    stick = SimulatedStick()
    stick.hold(Stick(-1.0, 0.0))
    helped = Helped(stick)
    helped.say = lambda text: helped.said.append(text)
    with pytest.raises(CohelmError, match=r"not held in the middle"):
        helped.run()


def test_the_trial_reports_an_axis_that_does_not_move():
    stick = SimulatedStick(aileron=Axis(unit=0.0))
    with pytest.raises(CohelmError, match=r"aileron .* did not move, pushed with 500"):
        Helped(stick).run()


def test_the_trial_recognizes_a_stick_that_falls_over():
    stick = SimulatedStick(Axis(unit=1e-6, friction=40.0))
    helped = Helped(stick)
    say = helped.say

    def falls(text: str) -> None:
        say(text)
        stick.elevator.held = 0.5 if "middle" in text else stick.elevator.held
        if "pushing" in text:
            stick.elevator.position, stick.elevator.held, stick.elevator.hand = 0.5, None, 5.0

    helped.say = falls
    with pytest.raises(CohelmError, match=r"same way|come to rest"):
        helped.run()
