"""Drives a robot with a stick of this machine: a station without a screen."""

from __future__ import annotations

import math
from typing import NamedTuple

from cohelm.link.messages import Command, Mode, RequestKind, is_centred
from cohelm.link.station_end import ReceivedStatus, StationEnd
from cohelm.link.sticks.feel import STILL, CueRules, damped, faded, returning, spring, wanted
from cohelm.link.sticks.port import Button, Feel, Reading, StickDevice


class SpeedLimits(NamedTuple):
    """The robot's largest speeds, for the cue."""

    speed: float
    """[m/s]"""
    yaw_rate: float
    """[rad/s]"""


class Helm:
    """Forwards a stick, 50 times a second or faster, and gives force feedback."""

    def __init__(
        self, end: StationEnd, device: StickDevice, limits: SpeedLimits, k_s: float,
        rules: CueRules | None = None,
    ) -> None:  # fmt: skip
        """k_s: constant of the spring (35)."""
        self._end, self._device, self._limits = end, device, limits
        self._spring = spring(k_s)
        self._rules = rules or CueRules()
        self._push = STILL
        self._armed = False
        self._last = math.nan

    def turn(self, now: float) -> Reading:
        """One period. now: a steady clock [s]."""
        reading = self._device.read()
        last = self._end.status()
        for button in reading.pressed:
            self._pressed(button, last)
        # Armed once it was centred, as on the robot: one rule at both ends.
        self._armed = reading.valid and (self._armed or is_centred(reading.stick))
        self._end.steer(Command(reading.stick, reading.valid, self._armed, self._device.kind))
        self._device.feel(self._cue(last, reading, now))
        return reading

    def _cue(self, last: ReceivedStatus | None, reading: Reading, now: float) -> Feel:
        dt = now - self._last if now > self._last else 0.0
        self._last = now
        push = STILL
        if last is not None and last.status.lease.you == last.status.lease.driver:
            speed, yaw_rate = self._limits
            push = wanted(last.status.nominal, last.status.applied, speed, yaw_rate, self._rules)
            push = faded(push, last.age, self._rules)
        self._push = damped(self._push, push, dt, self._rules)
        if not self._device.force:  # vibration does not move the stick
            return Feel(self._spring, self._push)
        return Feel(self._spring, returning(self._push, reading.stick, self._spring))

    def _pressed(self, button: Button, last: ReceivedStatus | None) -> None:
        if button is Button.STOP:
            self._end.ask(RequestKind.STOP)
        elif button is Button.RESET:
            self._end.ask(RequestKind.RESET)
        elif last is not None and button is Button.MODE:
            shared = last.status.mode is Mode.SHARED
            self._end.ask(RequestKind.MODE, Mode.AUTOMATIC if shared else Mode.SHARED)
        elif last is not None and button is Button.LEASE:
            drives = last.status.lease.driver == last.status.lease.you
            self._end.ask(RequestKind.GIVE if drives else RequestKind.TAKE)
