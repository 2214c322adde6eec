"""A robot whose driver reads the terminal, which is the loop's: prints what the loop reads."""

import os
import time
from pathlib import Path

import cohelm
from cohelm.robot.adapter import AdaptedMaker
from cohelm.robot.keep.gated_robot import rules
from cohelm.robot.keep.process import RemoteGatedRobot

SALLY = cohelm.load_robot("sally")


class Asks(cohelm.Robot):
    reads = 0

    def read(self) -> cohelm.Readings:
        self.reads += 1
        if self.reads > 5:
            with Path("/dev/tty").open() as terminal:
                terminal.readline()
        return cohelm.Readings(self.odometry(cohelm.Pose(0, 0, 0), cohelm.Twist(0, 0)))

    def send(self, twist: cohelm.Twist) -> None: ...

    def stop(self) -> None: ...


if __name__ == "__main__":
    os.close(os.open(os.ttyname(0), os.O_RDWR))  # from now on it is the terminal of this session
    gated = RemoteGatedRobot(AdaptedMaker(Asks, SALLY), rules(SALLY, 0.02))
    try:
        print("made", flush=True)
        time.sleep(0.5)
        print(gated.gate.reason or gated.read().health.faults, flush=True)
    finally:
        gated.close()
