"""Twists that Foxglove's Teleop panel publishes, as an operator's stick at the robot's link.

It is a client of the link, as the page and `cohelm stick` are: it takes the lease when nobody has
it, and is refused where somebody does. It drives in manual mode only. The panel says nothing when
its button is let go, so silence is a centred stick here, as long as the connection answers; in
manual mode the robot stands at both, and no other mode is driven in this way.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from cohelm.core.types import CENTRED, Stick, Twist
from cohelm.link.messages import Arming, Ask, Device, Mode
from cohelm.link.operator_input import STALE

if TYPE_CHECKING:
    from cohelm.law.gains import Gains
    from cohelm.link.keys import Keys
    from cohelm.link.station_end import StationEnd

ALIVE = 0.5
"""A connection that has not answered for so long is gone [s]."""
GIVES_BACK = 10.0
"""Who has pressed nothing for so long gives the lease back [s]."""
_PERIOD = 0.02
_AGAIN = 1.0
"""What was refused is asked for again, and told again, no sooner [s]."""
_CONNECTS = 3.0
"""A link that is not there by then is told of [s]."""
_OUT = 0.001
"""By so much out of the stick's dead band: without fore-aft, left-right alone would drive ahead
(45)."""


class Joined(NamedTuple):
    """How the robot's link is joined."""

    keys: Keys
    host: str
    port: int
    gains: Gains
    """Of the stick in manual mode at the robot's site."""


def stick_of(twist: Twist, gains: Gains) -> Stick:
    """The deflection that asks for a twist, or for as much of it as the whole stick does, on the
    same arc. Turning alone creeps ahead: that the stick has not."""
    x, psi = twist.v / (gains.k_hx * gains.u_d), twist.omega / gains.k_hpsi
    over = max(abs(x), abs(psi), 1.0)
    x, psi = x / over, psi / over
    if abs(psi) > gains.dead_band >= abs(x):
        x = math.copysign(min(gains.dead_band + _OUT, 1.0), x)
    return Stick(x, psi)


class FoxgloveTeleop:
    """Of one live view. All calls return at once; what there is to say is said from its thread."""

    def __init__(self, joined: Joined) -> None:
        self._joined = joined
        self._lock = threading.Lock()
        self._twist, self._came, self._answered = Twist(0.0, 0.0), -math.inf, -math.inf
        self._who: object = None
        """Whose twists count: of who published first."""
        self._say: Callable[[str], None] = lambda _: None
        self._over = threading.Event()
        self._thread: threading.Thread | None = None

    def publish(self, who: object, twist: Twist, say: Callable[[str], None]) -> str:
        """Somebody's twist; why it does not count, or nothing. say: hears sentences for them."""
        if not (math.isfinite(twist.v) and math.isfinite(twist.omega)):
            return "the twist is no number"
        with self._lock:
            now = time.monotonic()
            if self._who not in (None, who) and now - self._came < GIVES_BACK:
                return "somebody else who looks on steers already"
            self._who, self._say = who, say
            self._twist, self._came = twist, now
            self._answered = max(self._answered, now)
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="teleop", daemon=True)
                self._thread.start()
        return ""

    def answered(self, who: object) -> None:
        """Their connection answers."""
        with self._lock:
            if who is self._who:
                self._answered = time.monotonic()

    def gone(self, who: object) -> None:
        """Their connection, or their panel, is there no more."""
        with self._lock:
            if who is self._who:
                self._answered = -math.inf

    def close(self) -> None:
        """Drive no more."""
        self._over.set()
        if self._thread is not None:
            self._thread.join(2.0)

    def _run(self) -> None:
        """While somebody steers; a stick that is gone leaves the link."""
        from cohelm.link.station_end import StationEnd

        keys, host, port, gains = self._joined
        with StationEnd(keys, host, port) as end:
            hand, twist = _Hand(end, gains, self._tell), None
            while not self._over.wait(_PERIOD):
                with self._lock:
                    now = time.monotonic()
                    twist = self._twist if now - self._came <= STALE else None
                    alive, silent = now - self._answered <= ALIVE, now - self._came
                    if silent > GIVES_BACK or not alive:
                        self._who, self._thread, self._answered = None, None, -math.inf
                        break
                hand.turn(now, twist)
            hand.leave(twist is not None)

    def _tell(self, text: str) -> None:
        self._say(text)


class _Hand:
    """On the stick: takes the lease, asks for manual mode, and says why not."""

    def __init__(self, end: StationEnd, gains: Gains, say: Callable[[str], None]) -> None:
        self._end, self._gains, self._say = end, gains, say
        self._begun = time.monotonic()
        self._pressed = False
        self._asked: dict[Ask, tuple[int, float]] = {}
        self._told: dict[str, float] = {}

    def turn(self, now: float, twist: Twist | None) -> None:
        """Once. twist: None while nothing is pressed."""
        new, self._pressed = twist is not None and not self._pressed, twist is not None
        told = self._end.status()
        stick = CENTRED if twist is None else stick_of(twist, self._gains)
        mode = None if told is None else told.status.mode
        if told is None:
            if now - self._begun > _CONNECTS and not self._end.state().connected:
                self._tell(now, f"no link to the robot: {self._end.state().why}")
        elif twist is not None:
            lease = told.status.lease
            if lease.driver == 0:
                self._ask(now, Ask.TAKE)
            elif lease.driver != lease.you:
                self._tell(now, f"{lease.driver_name} drives, and has to give the lease back first")
            elif told.status.stopped:
                self._tell(now, f"stopped: {told.status.stopped}: reset it on the page")
            elif mode is not Mode.MANUAL and (new or Ask.MODE not in self._asked):
                self._ask(now, Ask.MODE, Mode.MANUAL)
            elif told.status.arming is not Arming.ARMED:
                self._tell(now, "let go of it once: the robot has not heard it all the time")
            elif told.status.why and math.hypot(*told.status.applied) < 1e-3:
                self._tell(now, told.status.why)
        # Another mode would take silence for a person who lets the controller lead.
        steers = mode is Mode.MANUAL or stick == CENTRED
        self._end.steer(stick if steers else CENTRED, True, True, Device.TOUCH)
        self._answers(now)

    def leave(self, pressed: bool) -> None:
        """pressed: it was gone in the middle of a press, and so is no stick that was let go."""
        told = self._end.status()
        if told is not None and told.status.lease.driver == told.status.lease.you and not pressed:
            given, until = self._end.ask(Ask.GIVE), time.monotonic() + 0.5
            while self._end.answer(given) is None and time.monotonic() < until:
                self._end.steer(CENTRED, True, True, Device.TOUCH)
                time.sleep(_PERIOD)
        self._end.steer(CENTRED, False, False, Device.TOUCH)
        time.sleep(2.0 * _PERIOD)  # so that the robot hears that the stick is gone

    def _ask(self, now: float, what: Ask, value: int = 0) -> None:
        before = self._asked.get(what)
        if before is None or now - before[1] > _AGAIN:
            self._asked[what] = self._end.ask(what, value), now

    def _answers(self, now: float) -> None:
        for number, _ in self._asked.values():
            said = self._end.answer(number)
            if said is not None and not said.granted:
                self._tell(now, f"refused: {said.reason}")

    def _tell(self, now: float, text: str) -> None:
        if now - self._told.get(text, -math.inf) > 5.0:
            self._told[text] = now
            self._say(text)
