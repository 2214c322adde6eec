"""What is shown and recorded while the readings are wrong: nothing that is not."""

import math

import pytest

from cohelm.core.types import Stick, Twist
from cohelm.drive.session import Session, SessionConfig
from cohelm.link.messages import Discs, Mode
from cohelm.link.operator import Scripted
from cohelm.robot.gate.modes import latched
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
