"""What is shown, recorded and printed while the readings are wrong: nothing that is not."""

import math
import time
from types import SimpleNamespace

import pytest

from cohelm.core.types import Stick, Twist
from cohelm.drive.recorder import Log
from cohelm.drive.session import Session, SessionConfig
from cohelm.drive.teleop_server import StopLines
from cohelm.link.messages import Discs, Mode
from cohelm.link.operator import Scripted
from cohelm.robot.gate.modes import GateMode, latched
from cohelm.robot.keep.record_pipe import Event
from tests.drive.faults import failing

STILL, UNKNOWN = Twist(0.0, 0.0), None
FAULTS = {
    "odometry stops": UNKNOWN,
    "odometry is not a number": UNKNOWN,
    "odometry is gone": UNKNOWN,
    "scans stop": STILL,
    "scans are no number": STILL,
}
"""What is shown to be measured once the robot stands."""


class Watching(Scripted):
    """What a station is sent."""

    def __init__(self) -> None:
        super().__init__(lambda _: Stick(0.0, 0.0), lambda: 0.0)
        self.discs = None

    def show(self, *parts) -> None:
        self.discs = next((one for one in parts if isinstance(one, Discs)), self.discs)


@pytest.mark.parametrize("fault", list(FAULTS))
def test_after_a_fault_no_motion_and_no_clearance_is_shown_that_is_not_there(fault):
    """The last command and the last twist stood there as long as the fault lasted; and obstacles
    grew by what they might do meanwhile, until they touched the robot."""
    watching = Watching()
    with Session(SessionConfig(failing(fault, at=3.0)), watching) as session:
        end = session.gated.now() + 8.0
        moved = []

        def over(loop) -> bool:
            if not latched(loop.gated.gate.mode):
                moved.append(watching.statuses[-1].applied.v)
            return loop.gated.now() > end

        session.run(over, Mode.AUTOMATIC)
        assert max(moved) > 0.1
        assert latched(session.gated.gate.mode)
    status = watching.statuses[-1]
    measured = FAULTS[fault]
    assert status.applied == STILL
    if measured is UNKNOWN:
        assert all(map(math.isnan, status.measured))
    else:
        assert status.measured == pytest.approx(measured, abs=0.02)
    assert math.isnan(status.clearance_seen)
    assert watching.discs is not None
    if fault.startswith("odometry"):  # scans still come
        assert len(watching.discs.rows) == 0


def test_a_robot_that_stations_drive_prints_each_stop_once(caplog):
    """Whoever looked at the terminal of `cohelm drive` saw nothing of any fault."""
    lines = StopLines()
    idle, fault = (GateMode.IDLE, ""), (GateMode.FAULTED, "the robot reports: read failed: OSError")
    stop = (GateMode.STOPPED, "stop by anna (1)")
    said = []
    for mode, reason in (idle, fault, fault, idle, fault, (GateMode.SHARED, ""), stop, stop):
        lines.turn(
            SimpleNamespace(gated=SimpleNamespace(gate=SimpleNamespace(mode=mode, reason=reason)))
        )
        time.sleep(0.05)  # a thread prints
        said = [record.getMessage() for record in caplog.records]
    assert said == [f"stopped: {reason}" for _, reason in (fault, fault, stop)]


def test_the_log_has_the_lines_of_a_traceback_below_each_other(tmp_path):
    log = Log(tmp_path / "drive.mcap")
    log(Event(1.0, "gate", "read failed:\nTraceback\n  here", True))
    log(Event(2.0, "gate", "next"))
    log.close(kept=True)
    lines = (tmp_path / "drive.log").read_text().splitlines()
    assert lines[0] == "     1.000 ! gate: read failed:"
    assert [line.strip() for line in lines[1:3]] == ["Traceback", "here"]
    assert all(line.startswith(" " * 13) for line in lines[1:3])
    assert lines[3].endswith("gate: next")


def test_after_a_fault_of_the_scan_the_limit_in_force_is_shown_with_what_happened():
    """It said that scans and odometry had disagreed, and the panel that there was no limit."""
    watching = Watching()
    with Session(SessionConfig(failing("scans are no number", at=3.0)), watching) as session:
        gated = session.gated

        def run(seconds: float) -> None:
            end = gated.now() + seconds
            session.loop.run(lambda loop: loop.gated.now() > end, real_time=False)

        def drive() -> None:
            assert session.loop.supervisor.choose(Mode.AUTOMATIC) == ""

        run(1.0)
        drive()
        run(4.0)
        assert latched(gated.gate.mode)
        gated._robot._fault = ""
        run(1.0)
        assert gated.reset() == ""
        run(0.1)
        said = "after a scan that was not a number, for up to 0.5 m: drive on"
        for _ in range(2):  # it stands, and then drives
            status = watching.statuses[-1]
            assert status.speed_cap == pytest.approx(0.08)
            assert status.cap_reason.startswith(said)
            drive()
            run(1.0)
        assert status.why.startswith(said)
        run(12.0)
        assert watching.statuses[-1].speed_cap == math.inf
