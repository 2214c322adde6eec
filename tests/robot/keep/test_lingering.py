"""A driver that does not let go: its gate process ends, and lets go of the hardware."""

import threading
import time

import pytest

import cohelm
from cohelm.robot.adapter import AdaptedMaker
from cohelm.robot.keep.gated_robot import rules
from cohelm.robot.keep.process import RemoteGatedRobot
from tests.robot.keep.test_processes import WITHIN, alive

pytestmark = pytest.mark.xdist_group("realtime")

SALLY = cohelm.load_robot("sally")


class Still(cohelm.Robot):
    def read(self) -> cohelm.Readings:
        return cohelm.Readings(self.odometry(cohelm.Pose(0, 0, 0), cohelm.Twist(0, 0)))

    def send(self, twist: cohelm.Twist) -> None: ...

    def stop(self) -> None: ...


class Hangs(Still):
    def close(self) -> None:
        time.sleep(1000.0)


class Threaded(Still):
    def __init__(self, model: cohelm.RobotModel) -> None:
        super().__init__(model)
        threading.Thread(target=time.sleep, args=(1000.0,)).start()


@pytest.mark.parametrize(("make", "lingers"), [(Hangs, True), (Threaded, True), (Still, False)])
def test_no_driver_keeps_the_gate_process_alive(make, lingers, capfd):
    gated = RemoteGatedRobot(AdaptedMaker(make, SALLY), rules(SALLY, 0.02))
    gated.close()
    end = time.monotonic() + WITHIN
    while alive(gated.pid) and time.monotonic() < end:
        time.sleep(0.05)
    assert not alive(gated.pid)
    assert ("the robot's driver does not end" in capfd.readouterr().err) == lingers
