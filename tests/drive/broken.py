"""A drive in real time, of the loop's own process, whose sensors fail once a file is there.

`python -m tests.drive.broken FAULT FILE RECORD`; prints the summary when the robot really stands,
and how long after its stop that was: without odometry the record can not know it.
"""

import json
import math
import sys
from pathlib import Path

from cohelm.drive.session import Session, SessionConfig
from cohelm.link.messages import Mode
from cohelm.robot.gate.modes import latched
from cohelm.robot.keep.gated_robot import STANDS_V
from tests.drive.faults import failing


def main() -> None:
    fault, when, record = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
    robot = failing(fault, math.inf, real_time=True, when=when)
    with Session(SessionConfig(robot, record=record)) as session:
        gated = session.loop.gated
        session.run(lambda _: latched(gated.gate.mode), Mode.AUTOMATIC)
        latched_at = gated.now()
        session.run(lambda _: abs(gated.truth().twist.v) < STANDS_V)
        stood = gated.now() - latched_at
        session.end("the drive is over")
        print(json.dumps(session.summary() | {"stood_after_s": stood}))


if __name__ == "__main__":
    main()
