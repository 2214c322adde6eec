"""Twists that Foxglove's Teleop panel publishes, as an operator's stick at the robot's link.

It is a client of the link, as the page and `cohelm stick` are: it takes the lease if that is free,
and is refused otherwise. It drives in manual mode only. The panel sends nothing once its button is
released, so silence is a centred stick here, as long as the connection answers; in manual mode the
robot stands for both, and no other mode is driven in this way.
"""

from __future__ import annotations

import asyncio
import json
import math
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from cohelm.core.errors import CohelmError
from cohelm.core.types import CENTRED, Stick, Twist
from cohelm.link.messages import Arming, Command, Device, Mode, RequestKind
from cohelm.link.operator import is_current
from cohelm.record.period import STORE
from cohelm.ros.foxglove_protocol import DATA, TO_SERVER

if TYPE_CHECKING:
    from cohelm.law.gains import Gains
    from cohelm.link.keys import Keys
    from cohelm.link.station_end import StationEnd

ALIVE = 0.5
"""A connection that has not answered for so long counts as lost [s]."""
RELEASE_AFTER = 10.0
"""The lease is given back after so long without a twist [s]."""
_PERIOD = 0.02
_RETRY = 1.0
"""A refused request is repeated no sooner [s]."""
_CONNECT_TIMEOUT = 3.0
"""A link that is not connected by then is reported [s]."""
_BEYOND_DEAD_BAND = 0.001
"""Least deflection beyond the dead band: left-right without fore-aft would drive ahead (45)."""
_HUGE = 1e300  # a larger number divided by the gains may be infinite


class Joined(NamedTuple):
    """How the robot's link is joined: keys, address, gains."""

    keys: Keys
    host: str
    port: int
    gains: Gains
    """Of the stick in manual mode at the robot's site."""


def stick_of(twist: Twist, gains: Gains) -> Stick:
    """The deflection with which the stick alone commands a twist: authority (44)(48) weakens a
    small deflection. Scaled down on the same arc to full deflection. The stick can not turn in
    place: such a twist creeps ahead."""
    x, psi = _to_full(twist.v / (gains.k_hx * gains.u_d), twist.omega / gains.k_hpsi)
    if gains.joint:
        wanted = math.hypot(x, psi)
        scale = _deflection(wanted, gains) / wanted if wanted > 0.0 else 0.0
        x, psi = scale * x, scale * psi
    else:
        x = math.copysign(_deflection(abs(x), gains), x)
        psi = math.copysign(_deflection(abs(psi), gains), psi)
    x, psi = _to_full(x, psi)
    if abs(psi) > gains.dead_band >= abs(x):
        x = math.copysign(min(gains.dead_band + _BEYOND_DEAD_BAND, 1.0), x)
    return Stick(x, psi)


def _to_full(x: float, psi: float) -> tuple[float, float]:
    """In the same direction, no farther than full deflection on either axis."""
    x, psi = max(min(x, _HUGE), -_HUGE), max(min(psi, _HUGE), -_HUGE)
    over = max(abs(x), abs(psi), 1.0)
    return x / over, psi / over


def _deflection(wanted: float, gains: Gains) -> float:
    """The deflection d with d (1 - exp(-k_s d^2 / 2)) = wanted, both >= 0."""
    if gains.k_s <= 0.0:  # the stick has no authority
        return wanted
    low, high = wanted, wanted + 1.0 / math.sqrt(gains.k_s)
    for _ in range(50):
        middle = 0.5 * (low + high)
        reached = middle * -math.expm1(-0.5 * gains.k_s * middle * middle)
        low, high = (middle, high) if reached < wanted else (low, middle)
    return high


class FoxgloveTeleop:
    """Steers for one live view. All calls return at once; messages are sent from its thread."""

    def __init__(self, joined: Joined) -> None:
        self._joined = joined
        self._lock = threading.Lock()
        self._twist, self._received, self._answered = Twist(0.0, 0.0), -math.inf, -math.inf
        self._owner: object = None
        """The publisher whose twists count: the first one."""
        self._say: Callable[[str], None] = lambda _: None
        self._over = threading.Event()
        self._thread: threading.Thread | None = None

    def publish(self, publisher: object, twist: Twist, say: Callable[[str], None]) -> str:
        """Take a publisher's twist; why it is refused, or "". say: shows it a sentence."""
        if not (math.isfinite(twist.v) and math.isfinite(twist.omega)):
            return "the twist is not a number"
        with self._lock:
            now = time.monotonic()
            if self._owner not in (None, publisher) and now - self._received < RELEASE_AFTER:
                return "another viewer is steering already"
            self._owner, self._say = publisher, say
            self._twist, self._received = twist, now
            self._answered = max(self._answered, now)
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="teleop", daemon=True)
                self._thread.start()
        return ""

    def answered(self, publisher: object) -> None:
        """The publisher's connection answers."""
        with self._lock:
            if publisher is self._owner:
                self._answered = time.monotonic()

    def gone(self, publisher: object) -> None:
        """The publisher's connection or panel is closed."""
        with self._lock:
            if publisher is self._owner:
                self._answered = -math.inf

    def close(self) -> None:
        """Stop steering."""
        self._over.set()
        if self._thread is not None:
            self._thread.join(2.0)

    def _run(self) -> None:
        """Steer until the publisher is silent or lost; then leave the link."""
        from cohelm.link.station_end import StationEnd

        keys, host, port, gains = self._joined
        try:
            end = StationEnd(keys, host, port)
        except (CohelmError, OSError) as error:
            with self._lock:
                self._owner = self._thread = None
            self._say(f"can not steer: {error}")
            return
        with end:
            client, twist = _StickClient(end, gains, lambda text: self._say(text)), None
            while not self._over.wait(_PERIOD):
                with self._lock:
                    now = time.monotonic()
                    twist = self._twist if is_current(now - self._received) else None
                    alive, silent = now - self._answered <= ALIVE, now - self._received
                    if silent > RELEASE_AFTER or not alive:
                        self._owner, self._thread, self._answered = None, None, -math.inf
                        break
                client.turn(now, twist)
            client.leave(twist is not None)


class _StickClient:
    """Moves the stick: takes the lease, requests manual mode, and reports refusals."""

    def __init__(self, end: StationEnd, gains: Gains, say: Callable[[str], None]) -> None:
        self._end, self._gains, self._say = end, gains, say
        self._begun = time.monotonic()
        self._pressed = False
        self._requested: dict[RequestKind, tuple[int, float]] = {}
        self._reported: dict[str, float] = {}

    def turn(self, now: float, twist: Twist | None) -> None:
        """Send one stick. twist: None while nothing is pressed."""
        new, self._pressed = twist is not None and not self._pressed, twist is not None
        last = self._end.status()
        stick = CENTRED if twist is None else stick_of(twist, self._gains)
        mode = None if last is None else last.message.mode
        if last is None:
            if now - self._begun > _CONNECT_TIMEOUT and not self._end.state().connected:
                self._note(now, f"no link to the robot: {self._end.state().why}")
        elif twist is not None:
            lease = last.message.lease
            if lease.driver == 0:
                self._ask(now, RequestKind.TAKE)
            elif lease.driver != lease.you:
                self._note(
                    now, f"{lease.driver_name} is the driver, and must release the lease first"
                )
            elif last.message.stopped:
                self._note(now, f"stopped: {last.message.stopped}: reset it on the page")
            elif mode is not Mode.MANUAL and (new or RequestKind.MODE not in self._requested):
                self._ask(now, RequestKind.MODE, Mode.MANUAL)
            elif last.message.arming is not Arming.ARMED:
                self._note(now, "release the stick once: commands to the robot were interrupted")
            elif last.message.why and math.hypot(*last.message.applied) < 1e-3:
                self._note(now, last.message.why)
        # In another mode a centred stick lets the controller lead.
        steers = mode is Mode.MANUAL or stick == CENTRED
        self._end.steer(Command(stick if steers else CENTRED, True, True, Device.TOUCH))
        self._report_refusals(now)

    def leave(self, pressed: bool) -> None:
        """Leave the link. pressed: the connection was lost during a press; the lease is kept."""
        last = self._end.status()
        if last is not None and last.message.lease.driver == last.message.lease.you and not pressed:
            given, until = self._end.ask(RequestKind.GIVE), time.monotonic() + 0.5
            while self._end.answer(given) is None and time.monotonic() < until:
                self._end.steer(Command(CENTRED, True, True, Device.TOUCH))
                time.sleep(_PERIOD)
        self._end.steer(Command(CENTRED, False, False, Device.TOUCH))
        time.sleep(2.0 * _PERIOD)  # so that the robot receives the lost stick

    def _ask(self, now: float, what: RequestKind, value: int = 0) -> None:
        before = self._requested.get(what)
        if before is None or now - before[1] > _RETRY:
            self._requested[what] = self._end.ask(what, value), now

    def _report_refusals(self, now: float) -> None:
        for number, _ in self._requested.values():
            answer = self._end.answer(number)
            if answer is not None and not answer.granted:
                self._note(now, f"refused: {answer.reason}")

    def _note(self, now: float, text: str) -> None:
        if now - self._reported.get(text, -math.inf) > 5.0:
            self._reported[text] = now
            self._say(text)


# Twists that a viewer publishes over Foxglove's protocol: parses their messages.


ENCODINGS = ("json", "cdr")
_TWIST, _STAMPED = "geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"
_KINDS = {
    "geometry_msgs/Twist": _TWIST, _TWIST: _TWIST,
    "geometry_msgs/TwistStamped": _STAMPED, _STAMPED: _STAMPED,
}  # fmt: skip
"""By their names in ROS 1 and ROS 2."""
_MAX_CHANNELS = 8
"""Channels of one viewer."""
_REPORT_PERIOD = 2.0
"""Least time from one reported refusal to the next [s]."""
_PING_PERIOD = 0.1
"""Period of pings [s]."""


class PublishedTwists:
    """The twists of one connection, in the server's loop; all but `keep_alive` returns at once."""

    def __init__(self, teleop: FoxgloveTeleop | None, report: Callable[[str], None]) -> None:
        """report: shows a sentence to the viewer; called from the server's loop."""
        self._teleop, self._report = teleop, report
        self._channels: dict[int, tuple[str, str]] = {}
        """Type and encoding of each."""
        self._event_loop: asyncio.AbstractEventLoop | None = None
        self._refusal_reported = -math.inf
        """When a refused twist was last reported [s]."""

    def advertise(self, channel: Any) -> None:
        """Open a channel. KeyError, TypeError for what is no channel."""
        number, topic = channel["id"], channel["topic"]
        name, encoding = channel["schemaName"], channel["encoding"]
        kind = _KINDS.get(name)
        if kind is None:
            self._report(f"{topic} is {name}: the robot is steered with {_TWIST} or TwistStamped")
        elif len(self._channels) >= _MAX_CHANNELS:
            self._report(f"{topic} is one too many: steer on one topic")
        elif encoding not in ENCODINGS:
            self._report(f"{topic} comes as {encoding}: it has to be {' or '.join(ENCODINGS)}")
        else:
            self._channels[int(number)] = kind, encoding

    def unadvertise(self, number: Any) -> None:
        """Close a channel."""
        if self._channels.pop(number, None) and not self._channels:
            self.gone()

    def take(self, data: bytes) -> None:
        """Take a message. ValueError, KeyError, TypeError or struct.error if it is malformed."""
        what, number = TO_SERVER.unpack_from(data)
        if what != DATA:
            raise ValueError
        if number not in self._channels or self._teleop is None:
            return  # of a channel that was refused
        kind, encoding = self._channels[number]
        twist = twist_of(data[TO_SERVER.size :], kind, encoding)
        self._event_loop = asyncio.get_running_loop()
        why, now = self._teleop.publish(self, twist, self._say), time.monotonic()
        if why and now - self._refusal_reported > _REPORT_PERIOD:
            self._refusal_reported = now
            self._report(why)

    def gone(self) -> None:
        """The viewer publishes no more."""
        if self._teleop is not None:
            self._teleop.gone(self)

    async def keep_alive(self, connection: ServerConnection) -> None:
        """Ping the viewer all the time, where it may steer."""
        while self._teleop is not None:
            try:
                answer = await connection.ping()
                async with asyncio.timeout(ALIVE):
                    await answer
                self._teleop.answered(self)
            except TimeoutError:
                pass
            except ConnectionClosed:
                return
            await asyncio.sleep(_PING_PERIOD)

    def _say(self, text: str) -> None:
        """Show a sentence; called from another thread."""
        if self._event_loop is not None:
            self._event_loop.call_soon_threadsafe(self._report, text)


def twist_of(data: bytes, kind: str, encoding: str) -> Twist:
    """A message's twist. ValueError, KeyError, TypeError or struct.error if it is malformed."""
    if encoding == "json":
        found: Any = json.loads(data)
        found = found["twist"] if kind == _STAMPED else found
        return Twist(float(found["linear"]["x"]), float(found["angular"]["z"]))
    try:
        message: Any = STORE.deserialize_cdr(data, kind)
    except Exception as error:  # whatever bytes do to it
        raise ValueError from error
    message = message.twist if kind == _STAMPED else message
    return Twist(float(message.linear.x), float(message.angular.z))
