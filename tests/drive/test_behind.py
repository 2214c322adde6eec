"""Backing into unobserved space, through the whole loop."""

import math

from cohelm.core.types import Stick
from cohelm.drive.factory import simulated
from cohelm.drive.session import Session, SessionConfig
from cohelm.link.messages import Mode
from cohelm.link.operator import Scripted
from tests.drive.faults import CORRIDOR


def test_backing_into_unobserved_space_is_slow_then_prevented_with_the_reason():
    made = simulated(CORRIDOR, "kinematic", real_time=False)
    box: list[Session] = []

    def stick(t: float) -> Stick:
        if t < 1.0 or 7.0 < t < 7.5:
            return Stick(0.0, 0.0)
        return Stick(-1.0, 0.0) if t < 4.0 or t > 10.0 else Stick(0.9, 0.0)

    operator = Scripted(stick, lambda: box[0].loop.gated.now() if box else 0.0)
    with Session(SessionConfig(made), operator) as session:
        box.append(session)

        def drive(until: float) -> float:
            session.run(lambda loop: loop.gated.now() >= until - 1e-9, Mode.MANUAL)
            return session.gated.truth().pose.x

        began = drive(1.5)
        drive(2.5)  # over ground that nobody has seen it backs slowly, and says so
        assert -0.32 < min(one.measured.v for one in operator.statuses) < -0.15
        assert any("never seen" in one.cap_reason for one in operator.statuses)
        backed = drive(4.0)
        assert -0.3 < backed < began + 0.01
        held = operator.statuses[-1]
        assert "unobserved space" in held.why
        assert held.clearance_seen > 0.5  # the walls are; that ground is not shown as a thing
        assert math.dist(held.limiting, (backed, 0.0)) < 0.8
        ahead = drive(10.0)
        assert ahead > backed + 1.5
        assert "unobserved space" not in operator.statuses[-1].why
        drive(11.5)  # back over what it drove over, as fast as it may
        assert min(one.measured.v for one in operator.statuses) < -0.45
        assert drive(13.0) < ahead - 0.8
