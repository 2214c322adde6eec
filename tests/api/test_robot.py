"""A robot of one's own: what the base class supplies, and what becomes of what goes wrong in it."""

import asyncio
import math
import re
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import cohelm
from cohelm.robot.adapter import AdaptedMaker, RobotAdapter
from cohelm.robot.contacts import ContactModel
from cohelm.robot.gate.gate import Proposal
from cohelm.robot.keep.gated_robot import LocalGatedRobot, rules
from cohelm.robot.port import Health

SALLY = cohelm.load_robot("sally")
REST = cohelm.Twist(0.0, 0.0)
HERE = cohelm.Pose(0.0, 0.0, 0.0)


class Cart(cohelm.Robot):
    """Notes what it is asked; time passes only in `wait`."""

    real_time = False

    def __init__(self) -> None:
        super().__init__(SALLY)
        self.t, self.asked, self.broken = 0.0, [], ""
        self.error: BaseException = OSError("the line is dead")

    def now(self) -> float:
        return self.t

    def wait(self, until: float) -> None:
        self.t = max(self.t, until)

    def fails(self, method: str) -> None:
        if self.broken == method:
            raise self.error

    def read(self) -> cohelm.Readings:
        self.fails("read")
        return cohelm.Readings(self.odometry(HERE, REST))

    def send(self, twist: cohelm.Twist) -> None:
        self.fails("send")
        self.asked.append((self.t, twist))

    def stop(self) -> None:
        self.fails("stop")
        self.asked.append((self.t, "stop"))


def test_no_twist_beyond_the_limits_or_not_finite_reaches_the_robot():
    cart = Cart()
    port = RobotAdapter(cart)
    for v, omega in ((9.0, 0.0), (-9.0, 30.0), (math.nan, 0.0), (0.0, math.inf), (0.5, 0.1)):
        port.send(cohelm.Twist(v, omega))
    bounds = SALLY.bounds()
    for _, twist in cart.asked:
        if twist != "stop":
            assert abs(twist.v) <= bounds.speed
            assert abs(twist.omega) <= bounds.yaw_rate
    assert [twist for _, twist in cart.asked].count("stop") == 1  # the second is still stopped
    assert cart.asked[-1][1] == cohelm.Twist(0.5, 0.1)


def test_no_robot_continues_without_commands():
    cart = Cart()
    port = RobotAdapter(cart)
    port.send(cohelm.Twist(0.5, 0.0))
    port.wait(0.4)
    assert cart.asked[-1][1] != "stop"
    port.wait(3.0)
    assert cart.asked[-1] == (0.5, "stop")


class Slow(Cart):
    """Its own clock is that on the wall, and its `read` can hang."""

    real_time = True

    def __init__(self) -> None:
        super().__init__()
        self.hangs, self.stopped = threading.Event(), threading.Event()
        self.hangs.set()

    def now(self) -> float:
        return time.monotonic()

    def read(self) -> cohelm.Readings:
        self.hangs.wait(10.0)
        return super().read()

    def stop(self) -> None:
        super().stop()
        self.stopped.set()


def test_no_call_that_hangs_keeps_the_robot_from_being_stopped():
    slow = Slow()
    port = RobotAdapter(slow)
    port.send(cohelm.Twist(0.5, 0.0))
    slow.hangs.clear()
    reader = threading.Thread(target=port.read)
    reader.start()
    assert slow.stopped.wait(5.0)
    assert reader.is_alive()
    slow.hangs.set()
    reader.join()
    port.close()


class Late(Slow):
    """Its `send` hangs, and then sets it going all the same."""

    def send(self, twist):
        self.hangs.wait(10.0)
        self.stopped.clear()


def test_a_robot_that_a_late_call_sets_going_again_is_stopped_again():
    late = Late()
    port = RobotAdapter(late)
    late.hangs.clear()
    sender = threading.Thread(target=port.send, args=(cohelm.Twist(0.5, 0.0),))
    sender.start()
    assert late.stopped.wait(5.0)
    late.hangs.set()
    sender.join()
    assert late.stopped.wait(5.0)
    port.close()


class Timeless(Slow):
    """Its clock fails."""

    dead = False

    def now(self):
        if self.dead:
            raise OSError("the line is dead")
        return super().now()


def test_a_robot_whose_clock_fails_is_stopped():
    timeless = Timeless()
    port = RobotAdapter(timeless)
    port.send(cohelm.Twist(0.5, 0.0))
    timeless.dead = True
    assert timeless.stopped.wait(5.0)
    timeless.stopped.clear()
    port.stop()
    assert timeless.stopped.wait(1.0)
    timeless.dead = False
    port.close()


def test_a_gate_whose_robots_clock_fails_stops_it_before_it_says_so():
    timeless = Timeless()
    gated = LocalGatedRobot(RobotAdapter(timeless), rules(SALLY, 0.02), watched_by=())
    timeless.dead = True
    with pytest.raises(OSError, match="the line is dead"):
        gated.fault("its clock failed")
    assert timeless.stopped.is_set()
    timeless.dead = False
    gated.close()


@pytest.mark.parametrize("method", ["read", "send", "stop"])
def test_no_error_of_the_robots_own_code_goes_unsaid(method):
    """It is a fault, which the gate latches; and it can be reset when it is over."""
    cart = Cart()
    port = RobotAdapter(cart)
    assert port.read().health.faults == ()
    cart.broken = method
    port.send(cohelm.Twist(0.3, 0.0))
    port.stop()
    said = port.read().health.faults
    assert said == (f"{method} failed: OSError: the line is dead",)
    cart.broken = ""
    port.read()
    port.send(cohelm.Twist(0.3, 0.0))
    assert port.read().health.faults == ()


ENDS = [
    (SystemExit(3), "SystemExit: 3"),
    (KeyboardInterrupt(), "KeyboardInterrupt"),
    (asyncio.CancelledError(), "CancelledError"),
]


@pytest.mark.parametrize("method", ["read", "send", "stop"])
@pytest.mark.parametrize(("error", "said"), ENDS)
def test_a_driver_that_would_end_its_process_is_a_fault_and_does_not(method, error, said):
    cart = Cart()
    port = RobotAdapter(cart)
    cart.broken, cart.error = method, error
    port.read()
    port.send(cohelm.Twist(0.3, 0.0))
    port.stop()
    assert port.read().health.faults == (f"{method} failed: {said}",)
    port.close()


class Unspeakable(Exception):
    def __str__(self) -> str:
        raise AttributeError("code")


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (Unspeakable(), "read failed: Unspeakable"),
        (ValueError("word " * 1_000_000), "read failed: ValueError: word word"),
        (cohelm.CohelmError("word " * 1_000_000), "word word"),
    ],
)
def test_what_a_driver_raises_is_said_however_long_or_broken(error, said):
    """A message to the loop has room for a megabyte, and an operator no time for so much."""
    cart = Cart()
    port = RobotAdapter(cart)
    cart.broken, cart.error = "read", error
    (found,) = port.read().health.faults
    assert found.startswith(said)
    assert len(found) <= 400
    assert found == said or found.endswith("…")


@pytest.mark.parametrize("own", [(), ("the button is pressed",)])
def test_a_fault_says_of_which_failed_call_it_is_or_that_the_robot_reports_it(own):
    """A sentence of ours, raised in a driver, names no call."""
    cart = Cart()
    port = RobotAdapter(cart)
    sound = cohelm.Readings(health=Health(0.0, 0.5, own))
    cart.read = lambda: sound
    assert port.read().health.failed is None
    cart.broken, cart.error = "send", cohelm.CohelmError("switch it on")
    port.send(REST)
    found = port.read().health
    assert found.faults == (*own, "switch it on")
    assert found.failed == (None if own else ("send", "switch it on"))
    assert port.read().health == sound.health


def test_faults_that_a_driver_reports_are_as_many_and_as_long_as_stations_show():
    cart = Cart()
    reported = Health(0.0, 0.5, ("word " * 1_000_000,) * 100)
    cart.read = lambda: cohelm.Readings(health=reported)
    found = RobotAdapter(cart).read().health.faults
    assert len(found) == 16
    assert all(len(fault) <= 400 and fault.endswith("…") for fault in found)


def test_a_robot_whose_stop_fails_is_sent_zero():
    """Or the last twist would stay until its hardware has noticed; and again, as nobody knows."""
    cart = Cart()
    port = RobotAdapter(cart)
    port.send(cohelm.Twist(0.5, 0.2))
    cart.broken = "stop"
    port.stop()
    assert cart.asked[-1] == (0.0, REST)
    assert port.read().health.faults == ("stop failed: OSError: the line is dead",)
    port.stop()
    assert cart.asked[-2:] == [(0.0, REST), (0.0, REST)]
    port.send(cohelm.Twist(0.5, 0.2))
    port.wait(3.0)
    assert cart.asked[-1] == (0.5, REST)
    cart.send = lambda twist: cart.fails("stop")  # nor does that work
    port.stop()
    assert port.read().health.faults == ("stop failed: OSError: the line is dead",)


@pytest.mark.parametrize(("error", "said"), ENDS)
def test_a_driver_that_ends_the_process_while_it_is_made_is_reported(error, said):
    def ends(model: cohelm.RobotModel) -> Cart:
        raise error

    with pytest.raises(cohelm.CohelmError, match=f"the robot can not be made: {said}$"):
        AdaptedMaker(ends, SALLY)()


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda model, port, baud: None, "not of model and port and baud: give all but the first"),
        (lambda model, *, port: None, "not of model and port: give all but the first a default"),
    ],
)
def test_a_driver_that_needs_more_than_its_model_is_told_what_it_gets(make, said):
    with pytest.raises(cohelm.CohelmError, match=said):
        AdaptedMaker(make, SALLY)()


def test_a_driver_may_take_more_than_its_model_that_has_defaults():
    for make in (lambda model, port="": Cart(), lambda *_, **__: Cart(), Cart, lambda: Cart()):
        assert AdaptedMaker(make, SALLY)().model == SALLY


class Failing(Cart):
    """Each of its calls fails; read in two ways."""

    reads = 0

    def read(self):
        self.reads += 1
        if self.reads % 2:
            raise OSError(f"no device, for the {self.reads}th time")
        return {}["a"]

    def send(self, twist):
        raise RuntimeError("send it is")

    def stop(self):
        raise RuntimeError("stop it is")

    def close(self):
        raise RuntimeError("close it is")


def test_where_a_driver_fails_is_logged_and_printed_once_for_each_kind_and_place(capfd):
    """The sentence alone does not say in which line of the driver."""
    events = []
    gated = LocalGatedRobot(
        RobotAdapter(Failing()), rules(SALLY, 0.02), events.append, watched_by=()
    )
    for number in range(20):
        gated.read()
        gated.propose(Proposal(number, gated.now(), cohelm.Twist(0.1, 0.0)))
    gated.close()
    texts = [event.text for event in events if "Traceback" in event.text]
    assert len(texts) == 4
    for call, line in (
        ("read", 'raise OSError(f"no device'), ("read", 'return {}["a"]'), ("stop", '"stop it is"'),
        ("close", '"close it is"'),
    ):  # fmt: skip
        found = [one for one in texts if one.startswith(f"{call} of the") and line in one]
        assert len(found) == 1, (call, texts)
        assert "adapter.py" not in found[0]
        assert "test_robot.py" in found[0]
    deadline, printed = time.monotonic() + 5.0, ""
    while printed.count("Traceback") < 4 and time.monotonic() < deadline:
        time.sleep(0.01)
        printed += capfd.readouterr().err
    assert printed.count("Traceback") == 4
    assert "no device, for the 1th time" in printed


class Careless(Cart):
    def close(self) -> None:
        raise asyncio.CancelledError


def test_a_driver_whose_close_fails_is_closed():
    RobotAdapter(Careless()).close()


ODOMETRY = cohelm.Odometry(0.0, cohelm.Pose(0.0, 0.0, 0.0), cohelm.Twist(0.0, 0.0))
SCAN = cohelm.Scan(0.0, 0, np.ones(3), 0.0)


@pytest.mark.parametrize(
    ("given", "why"),
    [
        (None, "read must return cohelm.Readings(...), got NoneType"),
        ((ODOMETRY, None), "read must return cohelm.Readings(...), got tuple"),
        (cohelm.Readings(ODOMETRY, [1.0, 2.0]), "scan must be made by self.scan(...), got list"),
        (cohelm.Readings((0.0, 0.0)), "odometry must be made by self.odometry(...), got tuple"),
        (cohelm.Readings(ODOMETRY._replace(pose=(0.0, 0.0, 0.0))), "made by self.odometry(...)"),
        (cohelm.Readings(ODOMETRY._replace(twist=("a", 0.0))), "made by self.odometry(...)"),
        (cohelm.Readings(ODOMETRY._replace(stamp=None)), "made by self.odometry(...)"),
        (cohelm.Readings(ODOMETRY, SCAN._replace(ranges=[1.0])), "made by self.scan(...)"),
        (cohelm.Readings(ODOMETRY, SCAN._replace(stamp="now")), "made by self.scan(...)"),
        (cohelm.Readings(ODOMETRY, SCAN._replace(number=None)), "made by self.scan(...)"),
        (cohelm.Readings(ODOMETRY, SCAN._replace(edges=[True])), "made by self.scan(...)"),
        (cohelm.Readings(further=SCAN), "further must be a tuple, further=(...,), got Scan"),
        (cohelm.Readings(contacts=True), "contacts must be a tuple, contacts=(...,), got bool"),
        (cohelm.Readings(further=[None]), "further must be made by self.scan(...), got NoneType"),
        (cohelm.Readings(contacts=(True,)), "contacts must be made by self.contact(...), got bool"),
        (cohelm.Readings(health="well"), "health must be a cohelm.robot.port.Health, got str"),
        (cohelm.Readings(health=Health(0.0, 0.5, None)), "health must be a cohelm.robot.port."),
        (cohelm.Readings(health=Health(0.0, 0.5, "low")), "health must be a cohelm.robot.port."),
        (cohelm.Readings(further=None), "further must be a tuple, further=(...,), got NoneType"),
    ],
)  # fmt: skip
def test_what_read_returns_and_is_no_reading_is_a_fault_that_says_so(given, why):
    """And does not end the gate process, in which the monitors look at it."""
    cart = Cart()
    cart.read = lambda: given
    port = RobotAdapter(cart)
    found = port.read()
    (said,) = found.health.faults
    assert why in said
    assert (found.odometry, found.scan, found.further, found.contacts) == (None, None, (), ())


_STAMP = 1_795_839_233.0


@pytest.mark.parametrize(
    ("made", "why"),
    [
        (
            lambda c: c.odometry(None, REST),
            "odometry takes pose (x, y, psi) and twist (v, omega), ",
        ),
        (lambda c: c.odometry(HERE, 0.3), "odometry takes pose (x, y, psi) and twist (v, omega), "),
        (
            lambda c: c.odometry(REST, HERE),
            "odometry takes pose (x, y, psi) and twist (v, omega), ",
        ),
        (
            lambda c: c.odometry(HERE, REST, age="new"),
            "age is how old a reading is in seconds, got 'new'",
        ),
        (
            lambda c: c.odometry(HERE, REST, age=None),
            "age is how old a reading is in seconds, got No",
        ),
        (
            lambda c: c.odometry(HERE, REST, age=_STAMP),
            "give the driver's clock of now less the stamp",
        ),
        (
            lambda c: c.scan(np.ones(720), age=_STAMP),
            "give the driver's clock of now less the stamp",
        ),
        (
            lambda c: c.scan(np.ones(720), duration="short"),
            "duration is a scan's in seconds, got 'short'",
        ),
        (lambda c: c.contact("front", None), "is pressed or is not, got None"),
    ],
)
def test_what_makes_no_reading_is_a_fault_that_says_what_to_give(made, why):
    cart = Cart()
    bumper = ContactModel(name="front", mount_x_m=0.36, width_m=0.4)
    cart.model = SALLY.model_copy(update={"bumpers": (bumper,)})
    cart.read = lambda: made(cart)
    (said,) = RobotAdapter(cart).read().health.faults
    assert why in said
    assert "Error" not in said


def test_a_traceback_of_a_driver_has_its_own_lines_and_none_of_this_package():
    """Its author looked for the mistake in our lines below it."""

    def read() -> cohelm.Readings:
        try:
            return cohelm.Readings(cart.odometry(HERE, REST, age="new"))
        except cohelm.CohelmError as error:
            raise OSError("no reading") from error

    cart = Cart()
    cart.read = read
    port = RobotAdapter(cart)
    port.read()
    said = port.traceback()
    assert "OSError: no reading" in said
    assert "got 'new'" in said
    assert {Path(name) for name in re.findall(r'File "(.*?)"', said)} == {Path(__file__)}


def test_an_error_of_several_lines_is_a_fault_of_one():
    cart = Cart()
    cart.broken, cart.error = "read", OSError("usb\n  unplugged\n")
    assert RobotAdapter(cart).read().health.faults == ("read failed: OSError: usb unplugged",)


@pytest.mark.parametrize(
    ("slots", "why"),
    [
        (("rear", ("front",)), "scan is one of 'rear': give it in further=(...,)"),
        (("front", ("front",)), "further has a scan of 'front': give it as scan"),
        (("front", ("",)), "further has a scan of no LiDAR's name: make it by self.scan(..., sens"),
        (("front", ("read",)), "further has a scan of 'read', and sally-rear has no such LiDAR"),
        (("front", ("rear",)), ""),
        (("", ("rear",)), ""),
        ((None, ()), ""),
    ],
)
def test_a_scan_in_the_place_of_another_lidars_is_a_fault(slots, why):
    """It would count where that one is mounted."""

    class Cart(cohelm.Robot):
        real_time = False

        def read(self) -> cohelm.Readings:
            first, further = slots
            scans = [SCAN._replace(sensor=name) for name in further]
            scan = None if first is None else SCAN._replace(sensor=first)
            return cohelm.Readings(ODOMETRY, scan, further=tuple(scans))

        def send(self, twist: cohelm.Twist) -> None: ...

        def stop(self) -> None: ...

    found = RobotAdapter(Cart(cohelm.load_robot("sally-rear"))).read()
    assert [why in said for said in found.health.faults] == ([True] if why else [])
    assert (found.odometry is None) == bool(why)


def test_a_lasting_stop_is_reported_repeatedly_but_not_at_every_call():
    cart = Cart()
    port = RobotAdapter(cart)
    port.send(cohelm.Twist(0.3, 0.0))
    for k in range(100):
        port.stop()
        port.wait(0.01 * (k + 1))
    stops = [t for t, twist in cart.asked if twist == "stop"]
    assert stops[0] == 0.0
    assert len(stops) in (10, 11)


def test_the_newest_message_stays_until_a_newer_one_comes():
    cart = Cart()
    port = RobotAdapter(cart)
    scan = cart.scan(np.ones(720))
    cart.read = lambda: cohelm.Readings(None, scan)
    assert port.read().scan is scan
    cart.read = lambda: cohelm.Readings(cart.odometry(HERE, REST))
    assert port.read().scan is scan
    assert port.read().odometry.stamp == cart.now()


def test_scans_are_numbered_stamped_and_as_rep_117_has_them():
    cart = Cart()
    cart.t = 2.0
    ranges = np.full(720, 1.0)
    ranges[:3] = 0.01, 99.0, math.nan
    scan = cart.scan(ranges.astype(np.float32), age=0.05, duration=0.1)
    assert scan.ranges[:2].tolist() == [-math.inf, math.inf]
    assert math.isnan(scan.ranges[2])  # a broken beam is for the loop to see
    assert scan.stamp == pytest.approx(1.85)
    assert (scan.number, cart.scan(ranges).number) == (0, 1)
    with pytest.raises(cohelm.CohelmError, match="has 720 beams, got shape"):
        cart.scan(ranges[1:])
    bare = Cart()
    bare.model = SALLY.model_copy(update={"lidar": None})
    with pytest.raises(cohelm.CohelmError, match="has no LiDAR"):
        bare.scan(ranges)


def test_ranges_in_millimetres_are_a_fault_that_says_so_and_no_empty_scan():
    cart = Cart()
    ranges = np.linspace(900.0, 4000.0, 720)
    ranges[:500] = 0.0  # what this LiDAR gives for no return
    cart.read = lambda: cohelm.Readings(scan=cart.scan(ranges))
    found = RobotAdapter(cart).read()
    (said,) = found.health.faults
    assert said.startswith("ranges are in metres, got 352")
    assert said.endswith(" in the median: divide millimetres by 1000")
    assert found.scan is None


def test_ranges_in_centimetres_are_a_fault_that_says_so_and_no_empty_scan():
    cart = Cart()
    with pytest.raises(cohelm.CohelmError, match=r"got 244.784 in the median: divide centimetres"):
        cart.scan(np.linspace(90.0, 400.0, 720))
    outdoors = np.linspace(13.0, 90.0, 720)  # farther than its description, and none the worse
    assert np.isinf(cart.scan(outdoors).ranges).all()


@pytest.mark.parametrize("none", [math.inf, 655.35, 65535.0, 1e9])
def test_whatever_a_driver_gives_for_no_return_is_not_taken_for_millimetres(none):
    cart = Cart()
    ranges = np.full(720, none)
    assert np.isinf(cart.scan(ranges).ranges).all()
    ranges[:9] = np.linspace(2.0, 4.0, 9)
    assert np.isfinite(cart.scan(ranges).ranges).sum() == 9


def test_scans_of_further_lidars_are_numbered_by_themselves_and_stay_until_newer_ones_come():
    cart = Cart()
    cart.model = cohelm.load_robot("sally-rear")
    port = RobotAdapter(cart)
    cart.t, ranges = 1.0, np.ones(720)
    front, rear = cart.scan(ranges), cart.scan(ranges, sensor="rear")
    assert [(one.number, one.sensor) for one in (front, rear)] == [(0, "front"), (0, "rear")]
    cart.read = lambda: cohelm.Readings(scan=front, further=(rear,))
    assert port.read().further == (rear,)
    newer = cart.scan(ranges)
    cart.read = lambda: cohelm.Readings(scan=newer)
    assert port.read()[1] is newer
    assert port.read().further == (rear,)
    later = cart.scan(ranges, sensor="rear")
    cart.read = lambda: cohelm.Readings(further=(later,))
    assert (port.read().further, later.number) == ((later,), 1)
    with pytest.raises(cohelm.CohelmError, match="has no LiDAR 'left': choose 'front', 'rear'"):
        cart.scan(ranges, sensor="left")


def test_no_robot_without_a_model_passes():
    class Bare(Cart):
        def __init__(self) -> None:
            pass

    with pytest.raises(cohelm.CohelmError, match="has no model"):
        RobotAdapter(Bare())
    with pytest.raises(cohelm.CohelmError, match="must be a subclass"):
        RobotAdapter(object())


class Seldom(Cart):
    """Its wheels speak 20 times a second; in between it gives the last reading with its age, which
    is worked out a moment before it is stamped."""

    def read(self) -> cohelm.Readings:
        k = math.floor(self.t / 0.05 + 1e-9)
        moment = 3e-4 if round(self.t / 0.02) % 2 else 0.0
        age = self.t - 0.05 * k + moment
        return cohelm.Readings(self.odometry(cohelm.Pose(0.01 * k, 0.0, 0.0), REST, age))


def test_a_reading_that_is_given_again_with_its_age_is_the_same_reading():
    port = RobotAdapter(Seldom())
    stamps, where = [], []
    for k in range(50):
        port.wait(0.02 * k)
        reading = port.read().odometry
        stamps.append(reading.stamp)
        where.append(reading.pose.x)
    assert stamps == sorted(stamps)
    assert len(set(stamps)) == len(set(where)) == 20
