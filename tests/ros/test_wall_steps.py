"""The wall clock of a machine is set, as by NTP after a boot, with drivers and filter on it."""

import re
import time

import pytest

from cohelm.core.types import Pose, Twist
from cohelm.loop.sensor_watchdog import SensorWatchdog, timeouts
from cohelm.robot.adapter import RobotAdapter
from cohelm.robot.plausibility.monitor import PlausibilityMonitor
from cohelm.ros.clock import TRANSIT
from cohelm.ros.look import look
from cohelm.ros.port import Received
from cohelm.ros.robot import Ros2Robot
from cohelm.ros.served import odometry, scan
from cohelm.ros.topics import Topics
from cohelm.sim.kinematic import Kinematic
from cohelm.sim.world import world
from tests.robot.plausibility.watched import ROOM, SALLY
from tests.ros.test_unheard import ENDS, FRAMES, Pretended, Spoken, readings

STEPS = [0.2, -0.2, 1.0, -1.0, 3600.0, -3600.0, 31_536_000.0, -31_536_000.0]
TICK = 0.005


class Machine:
    """Both clocks of a machine, moved on and set by hand, and what its drivers say."""

    def __init__(self, monkeypatch) -> None:
        self.passed, self.ahead = 100.0, 1.8e9
        monkeypatch.setattr(time, "monotonic", lambda: self.passed)
        monkeypatch.setattr(time, "time", lambda: self.ahead + self.passed)
        found = look(Pretended(ENDS, FRAMES + readings()), SALLY, Topics(), wait=0.0)
        self.robot = Ros2Robot(found.model, found, Spoken(ENDS))
        self.plant = Kinematic(SALLY, Pose(0.0, 0.0, 0.0), world(([], ROOM)), seed=3)
        self.now = self.plant.read()

    def drive(self) -> None:
        """A tick: what is new is stamped, and comes at the next."""
        self.passed += TICK
        before = self.now
        self.plant.wait(self.plant.now() + TICK)
        self.plant.send(Twist(0.3, 0.1))
        self.now = self.plant.read()
        ahead = time.time() - self.plant.now()
        if self.now.odometry is not before.odometry:
            message = odometry(self.now.odometry, ahead)
            self.robot._on_odometry(Received(message, self.passed))
        if self.now.scan is not before.scan:
            message = scan(self.now.scan, SALLY, ahead)
            self.robot._on_scan(SALLY.lidar.name, Received(message, self.passed))


@pytest.fixture
def machine(monkeypatch):
    made = Machine(monkeypatch)
    yield made
    made.robot.close()


@pytest.mark.parametrize("step", STEPS)
def test_a_clock_that_is_set_while_readings_are_under_way_does_not_show_in_them(machine, step):
    monitor, said, newest = PlausibilityMonitor(machine.robot.model), [], None
    ages = []
    for k in range(800):
        machine.drive()
        if k in (300, 301, 320, 500):  # between a stamp and a look at it, and else
            machine.ahead += step
        if k % 4 == 0:
            read = machine.robot.read()
            now = machine.robot.now()
            ages += [now - one.stamp for one in (read.odometry, read.scan) if one is not None]
            newest = read if newest is None else newest._replace(
                odometry=read.odometry or newest.odometry, scan=read.scan or newest.scan
            )  # fmt: skip
            found = monitor.observe(now, newest, Twist(0.3, 0.1))
            said += [found.reason] if found.reason else []
    assert said == []
    assert -0.021 < min(ages)
    assert max(ages) < 0.15


def test_what_is_stamped_an_hour_ago_without_a_step_or_long_after_it_is_old(machine):
    def age_of_next():
        while machine.robot.read().odometry is None:
            machine.drive()
        machine.ahead -= 3600.0  # the driver's own, and back for all else
        before = machine.robot._on_odometry
        seen = []
        machine.robot._on_odometry = seen.append
        while not seen:
            machine.drive()
        machine.ahead += 3600.0
        machine.robot._on_odometry = before
        before(seen[0])
        return machine.robot.now() - machine.robot.read().odometry.stamp

    assert age_of_next() > 3599.0
    machine.robot.read()
    machine.ahead += 3600.0
    for _ in range(round((TRANSIT + 0.1) / TICK)):
        machine.drive()
        machine.robot.read()
    assert age_of_next() > 3599.0


def test_a_stamp_decades_ago_is_a_reading_that_old_and_no_mistake_of_a_drivers_code(machine):
    """So that the watchdog tells of clocks, and not of how to write a `Robot`."""
    message = odometry(machine.now.odometry, 0.0)
    machine.robot._on_odometry(Received(message, machine.passed))
    port = RobotAdapter(machine.robot)
    read = port.read()
    assert read.health.faults == ()
    said = SensorWatchdog(SALLY, timeouts(SALLY, 0.02)).problem(machine.robot.now(), read)
    assert re.search(r"the odometry comes \d+ s after its stamp: a clock jumped|ms old", said)
