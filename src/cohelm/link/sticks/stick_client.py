"""Main loop of `cohelm stick`: connect, take the lease, forward the stick, and report changes."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import NamedTuple

from cohelm.core.types import CENTRED
from cohelm.link.bulk_messages import Hello
from cohelm.link.keys import Keys
from cohelm.link.messages import Arming, Command, Mode, RequestKind, Status, is_centred
from cohelm.link.station_bulk import StationBulk
from cohelm.link.station_end import StampedMessage, StationEnd
from cohelm.link.sticks.feel import damped, faded, returning, spring, wanted
from cohelm.link.sticks.port import Button, Feel, Reading, StickDevice, patience

PERIOD = 0.01
"""[s]; a hand feels more than 50 Hz, and the link sends the newest reading."""
STOOD = 0.5
"""Where this process stood still for longer, or its terminal did, it is not known when a button was
pressed: of those only a stop counts [s]. And so long the link speaks for it."""
_DRAINED = 0.1  # [s]; all that a device has kept meanwhile has then been read


class SpeedLimits(NamedTuple):
    """The robot's largest speeds, for the cue."""

    speed: float
    """[m/s]"""
    yaw_rate: float
    """[rad/s]"""


_UNKNOWN = SpeedLimits(1.0, 1.0)


def drive(
    device: StickDevice, keys: Keys, to: tuple[str, int], k_s: float, say: Callable[[str], None],
    until: Callable[[], bool] = lambda: False,
) -> None:  # fmt: skip
    """Run until the stick ends, `until` returns true, or Ctrl-C."""
    reporter = _Reporter(say)
    try:
        with (
            StationEnd(keys, *to, speaks_for=STOOD) as end,
            StationBulk(keys, *to, end.session) as bulk,
        ):
            say(f"{device.name}{' with force feedback' if device.force else ''}, to {to[0]}")
            limits = _limits(bulk)
            driven, taking = False, 0
            helm = Helm(end, device, limits, k_s)
            next_turn = time.monotonic()
            while not until():
                reading = helm.turn(time.monotonic())
                status = end.status()
                if status is not None and not driven:
                    lease = status.message.lease
                    driven = lease.driver == lease.you
                    if not taking or (lease.driver == 0 and end.answer(taking)):  # it was lost
                        taking = helm.take()
                reporter.changes(end, status, reading, helm.stuck)
                for refusal in helm.refusals:
                    say(refusal)
                helm.refusals.clear()
                if not reading.valid:
                    break  # a stick that is gone does not come back to this process
                next_turn = max(next_turn + PERIOD, time.monotonic())
                time.sleep(max(0.0, next_turn - time.monotonic()))
            end.steer(Command(CENTRED, False, False, device.kind))
            time.sleep(2.0 * PERIOD)  # so that the robot receives that the stick is gone
    finally:
        device.close()


def _limits(bulk: StationBulk) -> SpeedLimits:
    """The robot's largest speeds, from its first message."""
    end = time.monotonic() + 2.0
    while time.monotonic() < end:
        for message in bulk.news():
            if isinstance(message, Hello) and message.v_max > 0.0 and message.omega_max > 0.0:
                return SpeedLimits(message.v_max, message.omega_max)
        time.sleep(0.02)
    return _UNKNOWN


_ARMING = {
    Arming.ABSENT: "stick: none that is valid",
    Arming.WAITING: "stick: release it to the centre, then it steers",
    Arming.ARMED: "stick: ready",
}


class _Reporter:
    """Reports each change once."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._last: dict[str, str] = {}

    def changes(
        self, end: StationEnd, received: StampedMessage[Status] | None, reading: Reading, stuck: str
    ) -> None:
        """Report what differs from the last report."""
        state = end.state()
        self._report("link", "linked" if state.connected else f"no link: {state.why}")
        self._report("stick", stuck if reading.valid else reading.why)
        if received is None:
            return
        status = received.message
        mine = status.lease.driver == status.lease.you
        self._report(
            "lease", "you drive" if mine else f"{status.lease.driver_name or 'no one'} drives"
        )
        self._report("mode", f"mode: {status.mode.name.lower()}")
        self._report("stop", f"stopped: {status.stopped}" if status.stopped else "")
        self._report("arming", _ARMING[status.arming] if mine else "")

    def _report(self, what: str, text: str) -> None:
        if self._last.get(what, "") != text and text:
            self._say(text)
        self._last[what] = text


class Helm:
    """Forwards a stick, 50 times a second or faster, and gives force feedback."""

    def __init__(
        self, end: StationEnd, device: StickDevice, limits: SpeedLimits, k_s: float
    ) -> None:
        """k_s: constant of the spring (35)."""
        self._end, self._device, self._limits = end, device, limits
        self._spring = spring(k_s)
        self._push = CENTRED
        self._armed = False
        self._last = math.nan
        self._drained_at = -math.inf
        self._stick, self._changed_at = CENTRED, -math.inf
        self._asked: dict[int, str] = {}
        self.stuck = ""
        """Why the device's deflection is not believed; empty: it is."""
        self.refusals: list[str] = []
        """What the robot refused; whoever says it empties the list."""

    def turn(self, now: float) -> Reading:
        """One period; returns the device's reading. now: a steady clock [s]."""
        own = self._device.read()
        reading = self._believed(own, now)
        self._take_answers()
        last = self._end.status()
        if now - self._last > STOOD:
            self._drained_at = now + _DRAINED
        for button in reading.pressed:
            if button is Button.STOP or now >= self._drained_at:
                self._pressed(button, last)
        # Armed once it was centred, as on the robot: one rule at both ends.
        self._armed = reading.valid and (self._armed or is_centred(reading.stick))
        self._end.steer(Command(reading.stick, reading.valid, self._armed, self._device.kind))
        self._device.feel(self._cue(last, reading, now))
        return own

    def take(self) -> int:
        """Request the lease; returns the number of the answer."""
        return self._ask("take the lease", RequestKind.TAKE)

    def _believed(self, own: Reading, now: float) -> Reading:
        """The reading, or that there is no stick, as nobody can be holding it."""
        if own.stick != self._stick or own.pressed or not own.valid:
            self._stick, self._changed_at = own.stick, now
        most, self.stuck = patience(own.stick), ""
        if not (self._device.repeats and own.valid and now - self._changed_at > most):
            return own
        self.stuck = f"{self._device.name}: nothing new for {most:g} s: centre the stick"
        return own._replace(stick=CENTRED, valid=False, why=self.stuck)

    def _take_answers(self) -> None:
        for number, what in list(self._asked.items()):
            answer = self._end.answer(number)
            if answer is not None:
                del self._asked[number]
                if not answer.granted:
                    self.refusals.append(f"{what}: {answer.reason}")

    def _cue(self, last: StampedMessage[Status] | None, reading: Reading, now: float) -> Feel:
        dt = now - self._last if now > self._last else 0.0
        self._last = now
        push = CENTRED
        if last is not None and last.message.lease.you == last.message.lease.driver:
            speed, yaw_rate = self._limits
            push = wanted(last.message.nominal, last.message.applied, speed, yaw_rate)
            push = faded(push, last.age)
        self._push = damped(self._push, push, dt)
        if not self._device.force:  # vibration does not move the stick
            return Feel(self._spring, self._push)
        return Feel(self._spring, returning(self._push, reading.stick, self._spring))

    def _pressed(self, button: Button, last: StampedMessage[Status] | None) -> None:
        if button is Button.STOP:
            self._ask("stop", RequestKind.STOP)
        elif button is Button.RESET:
            self._ask("reset", RequestKind.RESET)
        elif last is not None and button is Button.MODE:
            mode = Mode.AUTOMATIC if last.message.mode is Mode.SHARED else Mode.SHARED
            self._ask(f"mode {mode.name.lower()}", RequestKind.MODE, mode)
        elif last is not None and button is Button.LEASE:
            if last.message.lease.driver == last.message.lease.you:
                self._ask("give back the lease", RequestKind.GIVE)
            else:
                self.take()

    def _ask(self, what: str, kind: RequestKind, value: int = 0) -> int:
        number = self._end.ask(kind, value)
        self._asked[number] = what
        return number
