"""Foxglove's Teleop panel steers as a client of the link."""

from __future__ import annotations

import json
import math
import socket
import struct
import time

import pytest

from cohelm.cli.live import live as live_view
from cohelm.core.errors import CohelmError
from cohelm.core.types import Stick, Twist
from cohelm.drive.foxglove_teleop import FoxgloveTeleop, Joined, stick_of, twist_of
from cohelm.drive.live import LiveConfig
from cohelm.drive.operate import DriveOptions
from cohelm.drive.robot_process import RobotProcess
from cohelm.drive.teleop_server import TeleopConfig
from cohelm.law.gains import Gains
from cohelm.law.human import blend, human, limited, operator_command
from cohelm.link.keys import pair_here, with_local_station
from cohelm.link.messages import Mode, RequestKind
from cohelm.link.station_end import StationEnd
from cohelm.loop.driver import by_hand
from cohelm.record.period import STORE
from cohelm.ros.messages import command
from tests.cli.test_bad_input import refused
from tests.drive.onlooker import Onlooker
from tests.patience import looks, started

pytestmark = pytest.mark.xdist_group("realtime")
TWIST, STAMPED = "geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"
GAINS = by_hand(Gains(u_d=0.5))


def said(v: float, omega: float) -> bytes:
    """As the panel says it, in JSON."""
    linear, angular = {"x": v, "y": 0.0, "z": 0.0}, {"x": 0.0, "y": 0.0, "z": omega}
    return json.dumps({"linear": linear, "angular": angular}).encode()


@pytest.mark.parametrize("kind", [TWIST, STAMPED])
def test_a_twist_is_the_same_in_either_encoding(kind):
    data = bytes(STORE.serialize_cdr(command(Twist(0.3, -0.4), kind, "base"), kind))
    assert twist_of(data, kind, "cdr") == Twist(0.3, -0.4)
    found = json.loads(said(0.3, -0.4))
    text = json.dumps({"header": {}, "twist": found} if kind == STAMPED else found)
    assert twist_of(text.encode(), kind, "json") == Twist(0.3, -0.4)


def nominal(stick: Stick, gains: Gains) -> Twist:
    """What the stick alone commands: there is no automatic part in manual mode."""
    operator = operator_command(stick, gains)
    return blend(Twist(0.0, 0.0), operator.twist, operator.authority)


@pytest.mark.parametrize("joint", [True, False])
@pytest.mark.parametrize(
    ("v", "omega"), [(0.45, 0.0), (-0.2, 0.0), (0.05, 0.0), (0.3, 0.6), (0.25, -0.1)]
)
def test_a_twist_within_reach_is_what_goes_into_the_filter(v, omega, joint):
    gains = GAINS._replace(joint=joint)
    assert tuple(nominal(stick_of(Twist(v, omega), gains), gains)) == pytest.approx((v, omega))


@pytest.mark.parametrize("v", [0.5, 3.0, 1e308])
def test_more_than_full_deflection_gives_is_full_deflection(v):
    assert stick_of(Twist(v, 0.0), GAINS) == Stick(1.0, 0.0)
    assert stick_of(Twist(-v, v), GAINS).x == pytest.approx(-stick_of(Twist(v, v), GAINS).x)


@pytest.mark.parametrize("band", [0.0, 0.05, 0.2])
def test_a_twist_beyond_the_limits_is_clipped_and_turning_in_place_creeps_ahead(band):
    gains = GAINS._replace(dead_band=band)
    assert stick_of(Twist(2.0, 2.0), gains) == pytest.approx((1.0, 0.5))  # on the same arc
    creeps = (band + 0.01) * gains.u_d
    for v in (0.0, 0.001):  # inside the dead band the law would drive ahead at full speed (45)
        assert 0.0 < human(limited(stick_of(Twist(v, 0.5), gains), gains), gains).v <= creeps
    assert human(limited(stick_of(Twist(-0.001, 0.5), gains), gains), gains).v >= -creeps
    assert stick_of(Twist(0.0, 0.0), gains) == Stick(0.0, 0.0)


def test_teleop_is_refused_off_loopback_and_without_a_live_view(cohelm):
    assert live_view("127.0.0.1", True).teleop
    assert not live_view("127.0.0.1").teleop
    with pytest.raises(CohelmError, match=r"in clear, .* could steer: .* ssh -L 8766"):
        live_view("0.0.0.0", True)
    with pytest.raises(CohelmError, match="add --foxglove"):
        live_view(None, True)
    teleop = ("--foxglove", "127.0.0.1", "--foxglove-teleop")
    refused(cohelm("robot", "lab-guard", *teleop), "add --listen 127.0.0.1, or use cohelm drive")


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as one:
        return one.getsockname()[1]


class Panel(Onlooker):
    """Foxglove with a Teleop panel."""

    def __init__(self, address: str, kind: str = "geometry_msgs/Twist", encoding="json") -> None:
        super().__init__(address, ["/cmd_vel", "/diagnostics"])
        channel = {"id": 7, "topic": "/cmd_vel", "encoding": encoding, "schemaName": kind}
        self.say(op="advertise", channels=[channel])

    def press(self, v: float, omega: float = 0.0) -> None:
        self.connection.send(struct.pack("<BI", 1, 7) + said(v, omega))

    def sees(self, until, within: float = 30.0, v: float | None = None) -> bool:
        """Whether something becomes true, while it presses at 20 Hz; v None: nothing is pressed."""
        due = 0.0
        for _ in looks(within, 0.005, 0.2):
            if v is not None and time.monotonic() >= due:
                due = time.monotonic() + 0.05
                self.press(v)
            while self.take(0.0):
                pass
            if until():
                return True
        return False

    def drives(self) -> bool:
        """Whether it does: it is pressed, and let go now and then, as a busy machine loses it."""
        drives = any(
            self.sees(lambda: self.v > 0.15, 3.0, 0.3) or self.sees(lambda: False, 0.6)
            for _ in range(8)
        )
        return drives

    @property
    def v(self) -> float:
        """What the wheels try [m/s]."""
        rows = self.heard["/cmd_vel"]
        return STORE.deserialize_cdr(rows[-1][1], STAMPED).twist.linear.x if rows else 0.0

    def was_told(self, words: str) -> bool:
        return any(words in one["message"] for one in self.told)

    def driver(self) -> str:
        for _, data in reversed(self.heard["/diagnostics"]):
            message = STORE.deserialize_cdr(data, "diagnostic_msgs/msg/DiagnosticArray")
            for one in message.status:
                if one.name == "driver":
                    return one.message
        return ""


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    of_robot, of_anna = pair_here("anna")
    view = LiveConfig(port=free_port(), teleop=True)
    door = TeleopConfig(of_robot, "127.0.0.1", 0, tmp_path_factory.mktemp("records"))
    options = DriveOptions("lab-guard", "lab-guard", "kinematic", True, None, [])
    with RobotProcess(options, door, patience=2.0, live=view) as made:
        assert started(made), made.over
        made.view, made.anna = view, of_anna
        yield made


def test_a_press_takes_the_lease_and_drives_and_a_release_stops_the_robot(robot):
    panel = Panel(robot.view.address)
    assert panel.info["capabilities"] == ["clientPublish"]
    assert panel.info["supportedEncodings"] == ["json", "cdr"]
    assert panel.drives(), panel.told
    assert panel.driver() == "foxglove"
    assert panel.sees(lambda: abs(panel.v) < 1e-3)  # nothing is said of letting go
    assert panel.drives(), panel.told  # and nothing was latched
    with StationEnd(robot.anna, robot.host, robot.port) as anna:
        panel.sees(lambda: anna.status() is not None, v=0.3)
        anna.ask(RequestKind.STOP)
        assert panel.sees(lambda: panel.was_told("reset it on the page"), v=0.3)
        assert panel.sees(lambda: abs(panel.v) < 1e-3, v=0.3)
        assert not panel.sees(lambda: panel.v > 0.05, 1.0, v=0.3)  # pressed, and stopped
        panel.close()  # and so it gives the lease back
        for _ in looks(30.0, 0.05, 0.2):
            if anna.status().message.lease.driver == 0:
                break
        anna.ask(RequestKind.TAKE)
        for _ in looks(30.0, 0.05, 0.2):
            lease = anna.status().message.lease
            if lease.driver == lease.you:
                break
        else:
            raise AssertionError("the lease was not given back")
        anna.ask(RequestKind.RESET)
        other = Panel(robot.view.address)
        drives = "anna is the driver, and must release the lease first"
        assert other.sees(lambda: other.was_told(drives), v=0.3), other.told
        assert not other.sees(lambda: other.v > 0.01, 1.0, v=0.3)
        assert anna.status().message.lease.driver == anna.status().message.lease.you
        anna.ask(RequestKind.GIVE)
        other.sees(lambda: anna.status().message.lease.driver == 0)
        other.close()


def test_a_lost_panel_is_not_a_released_stick(robot):
    panel = Panel(robot.view.address)
    with StationEnd(robot.anna, robot.host, robot.port) as anna:
        assert panel.drives(), panel.told
        panel.press(0.3)
        panel.connection.socket.shutdown(socket.SHUT_RDWR)
        for _ in looks(30.0, 0.05, 0.2):
            if "lost" in anna.status().message.stopped:
                break
        assert "lost" in anna.status().message.stopped
        assert anna.status().message.mode == Mode.HOLD


@pytest.mark.parametrize(
    ("kind", "encoding", "data", "why"),
    [
        ("std_msgs/msg/String", "json", b"{}", "/cmd_vel is std_msgs/msg/String: the robot is"),
        (TWIST, "ros1", b"", "/cmd_vel comes as ros1: it has to be json or cdr"),
        (TWIST, "json", said(math.nan, 0.0), "the twist is not a number"),
        (TWIST, "json", said(math.inf, 0.0), "the twist is not a number"),
        (TWIST, "json", b'{"linear": {"x": 1' + b"0" * 400 + b"}}", "invalid message"),
        (TWIST, "json", b'{"linear": 1}', "invalid message"),
        (TWIST, "json", b"[[[", "invalid message"),
        (TWIST, "cdr", b"\x00\x01\x00\x00\x01", "invalid message"),
    ],
)
def test_a_topic_that_can_not_steer_is_refused_with_the_reason(robot, kind, encoding, data, why):
    panel = Panel(robot.view.address, kind, encoding)
    panel.connection.send(struct.pack("<BI", 1, 7) + data)
    assert panel.sees(lambda: panel.was_told(why)), panel.told
    panel.close()


def test_only_one_viewer_steers_at_a_time(monkeypatch):
    of_robot, own = with_local_station(pair_here()[0], "foxglove")
    assert own.certificate in of_robot.trusted
    monkeypatch.setattr(FoxgloveTeleop, "_run", lambda self: None)
    teleop = FoxgloveTeleop(Joined(own, "127.0.0.1", 9, GAINS))
    assert teleop.publish("a", Twist(0.1, 0.0), print) == ""
    assert "another viewer is steering" in teleop.publish("b", Twist(0.1, 0.0), print)
    teleop._received -= 11.0
    assert teleop.publish("b", Twist(0.1, 0.0), print) == ""


def test_a_link_that_can_not_be_opened_is_reported_and_tried_again_with_the_next_press(monkeypatch):
    opened: list[int] = []

    def refused(*_: object) -> StationEnd:
        opened.append(1)
        raise CohelmError("the host 'robot' can not be found: check its name")

    monkeypatch.setattr("cohelm.link.station_end.StationEnd", refused)
    own, _ = pair_here()
    teleop, told = FoxgloveTeleop(Joined(own, "robot", 9, GAINS)), list[str]()
    for times in (1, 2):
        teleop.publish("panel", Twist(0.1, 0.0), told.append)
        assert any(len(told) == times for _ in looks(10.0, 0.01, 0.5))
    assert len(opened) == 2
    assert told == ["can not steer: the host 'robot' can not be found: check its name"] * 2
    teleop.close()
