"""Backing into unobserved space, through the whole loop."""

import math
from functools import partial

from cohelm.core.types import Stick
from cohelm.drive.factory import simulated
from cohelm.drive.session import Session, SessionConfig
from cohelm.link.messages import Mode
from cohelm.link.operator import Scripted
from tests.drive.faults import CORRIDOR


def test_backing_into_unobserved_space_is_prevented_with_the_reason():
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
        backed = drive(4.0)
        assert -0.3 < backed < began + 0.01
        held = operator.statuses[-1]
        assert "unobserved space" in held.why
        assert held.guarding.clearance > 0.5  # the walls are; that ground is not shown as a thing
        assert math.dist(held.guarding.limiting, (backed, 0.0)) < 0.8
        ahead = drive(10.0)
        assert ahead > backed + 1.5
        assert "unobserved space" not in operator.statuses[-1].why
        assert drive(13.0) < ahead - 0.8  # back over what it drove over


def test_over_ground_that_nobody_has_seen_it_backs_slowly_and_says_so():
    """Until it has looked there: then as fast as ahead."""
    made = simulated(CORRIDOR, "kinematic", real_time=False)
    box: list[Session] = []

    def stick(t: float) -> Stick:
        if t < 1.0:
            return Stick(0.0, 0.0)
        if t < 3.0 or t > 12.0:
            return Stick(-1.0, 0.0)
        return Stick(0.9, 0.0) if t < 10.0 else Stick(0.0, 0.0)

    operator = Scripted(stick, lambda: box[0].loop.gated.now() if box else 0.0)
    with Session(SessionConfig(made), operator) as session:
        box.append(session)

        def fastest_back(until: float) -> float:
            least = 0.0
            while session.loop.gated.now() < until:
                later = session.loop.gated.now() + 0.02
                session.run(partial(_reached, later), Mode.MANUAL)
                least = min(least, session.gated.truth().twist.v)
            return least

        session.run(lambda loop: loop.gated.now() >= 1.0, Mode.MANUAL)
        assert -0.31 < fastest_back(3.0) < -0.15
        assert any("never seen" in status.cap_reason for status in operator.statuses)
        session.run(lambda loop: loop.gated.now() >= 12.0, Mode.MANUAL)
        assert fastest_back(14.0) < -0.45
        assert "never seen" not in operator.statuses[-1].cap_reason


def _reached(time, loop):
    return loop.gated.now() >= time - 1e-9
