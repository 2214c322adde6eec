"""A simulated robot in the station's own process, under the paper's law, behind `RobotLink`.

For trying the station's pages alone: no network, no guard, no loop in real time.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from cohelm.core.errors import CohelmError
from cohelm.core.types import Floats, Pose, Stick, Twist
from cohelm.drive.walls import drawn
from cohelm.law.reference import Reference, desired, through
from cohelm.law.track import pose_error
from cohelm.link import messages as m
from cohelm.link.station_end import WholeScan
from cohelm.robot.kinematics import arc
from cohelm.robot.limits import achievable
from cohelm.robot.sensors import LidarModel
from cohelm.sim.grid import grid
from cohelm.sim.lidar import scan
from cohelm.sim.loop import State, at_rest, turn
from cohelm.sim.run import Setup
from cohelm.sim.world import NOWHERE, clearance, place
from cohelm.station.robot_link import News, Quality

PERIOD = 0.02
ANSWER_WITHIN = 10.0
_NO_MAP = grid(np.zeros((0, 0), dtype=np.bool_), 1.0, Pose(0.0, 0.0, 0.0))
_CENTRED = Stick(0.0, 0.0)
_NOTHING = m.Command(_CENTRED, False, False, m.Device.NONE, 1.0, ())


@dataclass
class _Client:
    number: int
    name: str
    command: m.Command = _NOTHING
    answers: dict[int, m.Answer] = field(default_factory=dict[int, m.Answer])
    requests: int = 0
    heard: dict[object, News] = field(default_factory=dict[object, News])

    def hear(self, message: m.FromRobot | WholeScan, stamp: float) -> None:
        """Keep the newest of each kind."""
        slot = (type(message), message.what if isinstance(message, m.Polyline) else 0)
        self.heard[slot] = News(message, stamp, 0.0)


class SimulatedRobot:
    """Lives in a thread of its own from `start` to `close`."""

    def __init__(self, setup: Setup, name: str, lidar: LidarModel | None) -> None:
        self.setup, self.name = setup, name
        self._lidar = (lidar or LidarModel()).lidar()
        self._scan_every = max(1, round(1.0 / (10.0 * PERIOD)))
        self.lock = threading.RLock()
        self._clients: dict[int, _Client] = {}
        self._count = 0
        self._driver = self._asking = 0
        self._until = math.nan
        self._mode = m.Mode.HOLD
        self._stopped = ""
        self._used = False
        self._armed = False
        self._alarms: list[m.Alarm] = []
        self._alarm_count = 0
        self._reference = setup.reference
        self._waypoints = setup.reference.knots
        self._time = self._progress = 0.0
        self._state = at_rest(setup.start)
        self._asked = self._given = Twist(0.0, 0.0)
        self._open = True
        self._thread = threading.Thread(target=self._run, name="simulated robot", daemon=True)

    def start(self) -> None:
        """Let time pass."""
        self._thread.start()

    def close(self) -> None:
        """End it."""
        self._open = False
        self._thread.join(2.0)

    def connect(self, name: str) -> SimulatedLink:
        """One more operator."""
        with self.lock:
            self._count += 1
            client = _Client(self._count, name)
            self._clients[client.number] = client
            for message in self._first():
                client.hear(message, self._time)
        return SimulatedLink(self, client)

    # ---- what is told ------------------------------------------------------------------

    def _first(self) -> list[m.FromRobot]:
        limits = self.setup.limits
        nan = math.nan
        return [
            m.Hello(
                self.name, "simulated", self.setup.outline.astype(np.float32),
                min(limits.speed, 1.5), min(limits.yaw_rate, 2.0), 0.3, "stop",
                (nan, nan, nan, nan),
            ),
            drawn(self.setup.around.walls, np.zeros((1, 2))), *self._lines(), m.Records(()),
        ]  # fmt: skip

    def _lines(self) -> list[m.Polyline]:
        r = self._reference
        times = np.linspace(0.0, r.duration, 400)
        line = np.array([desired(r, t, False)[:2] for t in times], dtype=np.float32)
        knots = np.array([desired(r, t, False)[:2] for t in r.knots], dtype=np.float32)
        return [m.Polyline(m.Line.REFERENCE, line), m.Polyline(m.Line.WAYPOINTS, knots)]

    def _tell(self, message: m.FromRobot | WholeScan) -> None:
        for client in list(self._clients.values()):
            client.hear(message, self._time)

    def _status(self, client: _Client, s: _Now) -> m.Status:
        driver = self._clients.get(self._driver)
        asking = self._clients.get(self._asking)
        pose, nan = self._state.pose, math.nan
        stick = self._stick()
        arming = m.Arming.ARMED if self._armed else m.Arming.WAITING
        return m.Status(
            m.Lease(client.number, self._driver, driver.name if driver else "", self._asking,
                    asking.name if asking else "", self._until - time.monotonic()),
            self._mode, self._stopped, arming if s.valid else m.Arming.ABSENT, stick, s.automatic,
            pose, pose, self._given, self._asked, self._given, s.why,
            m.Guarding(m.Verdict.UNTOUCHED, s.gap, (nan, nan), s.h), s.e_p,
            Pose(*desired(self._reference, self._progress, False)[:3]),
            min(self._progress / self._reference.duration, 1.0), math.inf, "",
            m.Localised.EXACT, nan, False, m.Timing(0.0, 0, 0.0, 0.0, 0.0, 0),
            tuple(self._alarms[:4]), (),
            tuple(arc(pose, self._given, 0.2 * k)[:2] for k in range(1, 11)), 0.2,
        )  # fmt: skip

    # ---- what is done ------------------------------------------------------------------

    def _run(self) -> None:
        next_at = time.monotonic()
        k = 0
        while self._open:
            next_at = max(next_at + PERIOD, time.monotonic() - 0.1)
            with self.lock:
                self._turn(k)
            k += 1
            time.sleep(max(next_at - time.monotonic(), 0.0))

    def _stick(self) -> Stick:
        driver = self._clients.get(self._driver)
        return driver.command.stick if driver and self._armed else _CENTRED

    def _turn(self, k: int) -> None:
        setup = self.setup
        now = time.monotonic()
        self._time += PERIOD
        if self._asking and now > self._until:
            self._lease(self._asking)
        driver = self._clients.get(self._driver)
        command = driver.command if driver else None
        valid = command is not None and command.valid
        self._arm(command)
        discs = np.empty((len(setup.around.discs), 6))
        place(discs, 0, setup.around, self._time)
        stick = self._stick()
        reference = desired(self._reference, self._progress, setup.spline_speed)
        before = self._state.applied
        _, wish, _ = turn(
            0, PERIOD, self._state, stick, reference, discs, setup.gains, setup.limits,
            np.zeros((0, 2)),
        )  # fmt: skip
        asked = Twist(wish.v, wish.omega)
        why, go = "", asked
        if self._stopped:
            why, go = self._stopped, Twist(0.0, 0.0)
        elif self._mode is m.Mode.HOLD:
            why, go = "holding", Twist(0.0, 0.0)
        elif self._mode is m.Mode.MANUAL:
            go = Twist(wish.human_v, wish.human_omega)
        scale = command.speed_scale if command else 1.0
        given = achievable(Twist(go.v * scale, go.omega * scale), before, setup.limits, PERIOD)
        pose = arc(self._state.pose, given, PERIOD)
        self._state = State(pose, given, stick, 0.0)
        if why == "" and self._mode is not m.Mode.MANUAL:
            self._progress = min(self._progress + PERIOD * scale, self._reference.duration)
        self._asked, self._given = asked, given
        reach = float(np.hypot(*setup.outline.T).max())
        gap = clearance(pose, setup.outline, reach, discs, setup.around.walls, NOWHERE)
        said = _Now(why, valid, wish.authority_x, wish.h, gap, pose_error(pose, reference))
        for client in list(self._clients.values()):
            client.hear(self._status(client, said), self._time)
        if k % 5 == 0:
            self._tell(m.Discs(k, discs[:40].astype(np.float32)))
        if k % self._scan_every == 0:
            self._scan(k, pose, discs)

    def _arm(self, command: m.Command | None) -> None:
        valid = command is not None and command.valid and command.armed
        if not valid:
            if self._armed and self._used:
                self._stopped = "the stick was lost in use"
                self._alarm("The stick was lost while it was in use")
            self._armed = self._used = False
            return
        assert command is not None
        deflected = max(abs(command.stick.x), abs(command.stick.psi)) > 0.1
        if not self._armed and not deflected:
            self._armed = True
        self._used = self._armed and deflected

    def _scan(self, k: int, pose: Pose, discs: Floats) -> None:
        ranges = np.empty(len(self._lidar.beams))
        scan(pose, self._lidar, discs, self.setup.around.walls, _NO_MAP, 0, k, ranges)
        mm = np.where(np.isfinite(ranges), np.clip(ranges * 1e3, 1, 65000), 65535).astype(np.uint16)
        mount = self._lidar.mount
        c, s = math.cos(pose.psi), math.sin(pose.psi)
        sensor = Pose(
            pose.x + c * mount.x - s * mount.y, pose.y + s * mount.x + c * mount.y,
            pose.psi + mount.psi,
        )  # fmt: skip
        self._tell(WholeScan(k, self._time, sensor, self._lidar.first, self._lidar.step, mm))

    def _alarm(self, text: str) -> None:
        self._alarm_count += 1
        self._alarms.insert(0, m.Alarm(self._alarm_count, m.Severity.ALARM, True, False, text))

    def _lease(self, to: int) -> None:
        self._driver, self._asking, self._until = to, 0, math.nan
        self._armed = self._used = False

    def steer(self, client: _Client, command: m.Command) -> None:
        """The newest command of a client."""
        client.command = command

    def ask(self, client: _Client, what: m.Ask, value: int) -> int:
        """Do a request now."""
        with self.lock:
            client.requests += 1
            granted, why = self._ask(client, what, value)
            client.answers[client.requests] = m.Answer(client.requests, granted, why)
            return client.requests

    def _ask(self, client: _Client, what: m.Ask, value: int) -> tuple[bool, str]:
        drives = self._driver == client.number
        match what:
            case m.Ask.STOP:
                self._stopped = f"stopped by {client.name}"
                return True, ""
            case m.Ask.ACKNOWLEDGE:
                self._alarms = [a for a in self._alarms if value not in (0, a.number)]
                return True, ""
            case m.Ask.TAKE:
                if self._driver == 0 or drives:
                    self._lease(client.number)
                    return True, ""
                self._asking, self._until = client.number, time.monotonic() + ANSWER_WITHIN
                return True, "the driver is asked"
            case _ if not drives:
                return False, "you do not drive"
            case m.Ask.GIVE:
                self._lease(value or self._asking)
            case m.Ask.REFUSE:
                self._asking, self._until = 0, math.nan
            case m.Ask.RESET:
                self._stopped = ""
                self._alarms = [a._replace(active=False) for a in self._alarms]
            case m.Ask.MODE:
                self._mode = m.Mode(value)
            case _:
                return False, "this simulated robot does not record"
        return True, ""

    def propose(self, client: _Client, points: Floats, only_check: bool) -> int:
        """Check a way, and take it."""
        with self.lock:
            client.requests += 1
            made, why, worst = self._way(points)
            client.hear(
                m.Checked(m.Answer(client.requests, made is not None, why), worst), self._time
            )
            if made is not None and not only_check and self._driver == client.number:
                self._reference, self._progress = made, 0.0
                for line in self._lines():
                    self._tell(line)
            return client.requests

    def _way(self, points: Floats) -> tuple[Reference | None, str, int]:
        outline, walls = self.setup.outline, self.setup.around.walls
        reach = float(np.hypot(*outline.T).max())
        none = np.empty((0, 6))
        for i, (x, y) in enumerate(points):
            gap = clearance(Pose(x, y, 0.0), outline, reach, none, walls, NOWHERE)
            if gap < 0.05:
                return None, f"way-point {i + 1} is too near a wall", i
        pose = self._state.pose
        try:
            made = through(np.vstack(((pose.x, pose.y), points)), self._reference.speed)
        except CohelmError as error:
            return None, str(error), 65535
        return made, "", 65535

    def leave(self, client: _Client) -> None:
        """A client goes."""
        with self.lock:
            self._clients.pop(client.number, None)
            if self._driver == client.number:
                self._lease(self._asking)
            if self._asking == client.number:
                self._asking = 0


@dataclass(frozen=True)
class _Now:
    why: str
    valid: bool
    automatic: float
    h: float
    gap: float
    e_p: float


class SimulatedLink:
    """An operator's way to it."""

    def __init__(self, robot: SimulatedRobot, client: _Client) -> None:
        self._robot, self._client = robot, client

    def news(self) -> list[News]:
        """All that is new."""
        with self._robot.lock:
            new = list(self._client.heard.values())
            self._client.heard.clear()
        return new

    def answer(self, number: int) -> m.Answer | None:
        """At once."""
        return self._client.answers.get(number)

    def steer(
        self, stick: Stick, valid: bool, armed: bool, device: m.Device, speed_scale: float
    ) -> None:
        """The newest wins."""
        command = m.Command(stick, valid, armed, device, speed_scale, ())
        self._robot.steer(self._client, command)

    def ask(self, what: m.Ask, value: int = 0) -> int:
        """Ask for something once."""
        return self._robot.ask(self._client, what, value)

    def propose(self, points: Sequence[tuple[float, float]], only_check: bool) -> int:
        """Way-points."""
        return self._robot.propose(self._client, np.array(points, dtype=float), only_check)

    def fetch(self, name: str) -> None:
        """It has no records."""
        self._client.hear(m.Piece(name, 0, b"") if name else m.Records(()), 0.0)

    def quality(self) -> Quality:
        """Perfect."""
        return Quality(True, "this process", "", 0.0, 0.0, 0.0)

    def close(self) -> None:
        """Leave."""
        self._robot.leave(self._client)
