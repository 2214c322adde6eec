"""Robots by somebody else, as a stranger would write them: inside, a simulated one."""

from __future__ import annotations

from pathlib import Path

import cohelm
from cohelm.robot.clock import WallClock
from cohelm.scenario.load import scenario
from cohelm.sim.kinematic import Kinematic

SITE = Path(__file__).parents[1] / "drive" / "corridor.yaml"


class Cart(cohelm.Robot):
    """In real time, without a time-out of its own."""

    def __init__(self, model: cohelm.RobotModel) -> None:
        super().__init__(model)
        clock = WallClock() if self.real_time else None
        around = scenario(SITE).build_world()
        self.inside = Kinematic(model, cohelm.Pose(0.0, 0.0, 0.0), around, timeout=1e6, clock=clock)
        self.now, self.wait = self.inside.now, self.inside.wait
        self.number = -1

    def read(self) -> cohelm.Readings:
        odometry, scan, *_ = self.inside.read()
        if scan is None or scan.number == self.number:
            return cohelm.Readings(odometry)
        self.number = scan.number
        return cohelm.Readings(odometry, self.scan(scan.ranges, self.now() - scan.stamp))

    def send(self, twist: cohelm.Twist) -> None:
        self.inside.send(twist)

    def stop(self) -> None:
        self.inside.stop()


class Simulated(Cart):
    """The same in simulated time."""

    real_time = False


class Talking(Simulated):
    """Prints what it does."""

    def stop(self) -> None:
        print("stop")
        super().stop()


class Dying(Simulated):
    """Its wheels' line dies after three seconds."""

    def send(self, twist: cohelm.Twist) -> None:
        if self.now() > 3.0:
            raise OSError("the line is dead")
        super().send(twist)


class NoArguments(Simulated):
    """Knows its own model."""

    def __init__(self) -> None:
        super().__init__(cohelm.load_robot("sally"))


class Other(Simulated):
    """Describes another robot than the one it is said to be."""

    def __init__(self, model: cohelm.RobotModel) -> None:
        super().__init__(model.model_copy(update={"delay_s": 0.5}))


class Broken(cohelm.Robot):
    """Can not be made."""

    def __init__(self, model: cohelm.RobotModel) -> None:
        raise OSError("no such device")

    def read(self) -> cohelm.Readings:
        return cohelm.Readings()

    def send(self, twist: cohelm.Twist) -> None: ...

    def stop(self) -> None: ...
