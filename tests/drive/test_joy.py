"""A joystick on a ROS 2 topic has the rules of a stick."""

from __future__ import annotations

import pytest

from cohelm.core.errors import CohelmError
from cohelm.drive.factory import simulated
from cohelm.drive.on_topics import OnTopics, TopicsConfig, on_topics
from cohelm.drive.session import Session, SessionConfig
from cohelm.link.messages import Mode
from cohelm.robot.gate.modes import GateMode
from tests.drive.faults import CORRIDOR, along_corridor
from tests.ros.test_joy import Topic


class Seen:
    """What became of it at each time."""

    def __init__(self) -> None:
        self.speeds: dict[float, float] = {}
        self.reasons: dict[float, str] = {}
        self.gate = None


def driven(mode: Mode, hand, seconds: float, **params) -> Seen:
    """hand: what the joystick says at a time: (x, held), or None where it is silent."""
    made = along_corridor(8.0)
    joy, seen = Topic(**params), Seen()
    joy.now = 0.0
    topics = OnTopics(None, None, joy=joy.operator)
    with Session(SessionConfig(made, localise=False), joy.operator) as session:
        gated = session.loop.gated
        begun = joy.now = gated.now()
        topics.begin(session)

        def until(loop) -> bool:
            joy.now = gated.now()
            t = round(joy.now - begun, 2)
            said = hand(t)
            if said is not None:
                joy.say(said[0], 1e-9 * t, said[1])  # a hand trembles
            topics.turn(loop)
            seen.speeds[t] = gated.truth().twist.v
            seen.reasons[t] = loop.supervisor.paused
            return t >= seconds

        session.run(until, mode)
        seen.gate = gated.gate
    topics.close()
    return seen


def fastest(seen: Seen, begin: float, end: float) -> float:
    return max(abs(v) for t, v in seen.speeds.items() if begin <= t < end)


def by_hand(t):
    if t < 0.5:
        return None  # not switched on yet
    if t < 1.0:
        return 0.8, True  # held before it was centred
    if t < 1.4:
        return 0.0, True
    if 2.4 <= t < 3.4:
        return 0.8, False  # the button is let go
    if 4.4 <= t < 4.9:
        return None  # the receiver drops out for a moment
    if 4.9 <= t < 5.5:
        return 0.0, True
    return (0.8, True) if t < 6.2 else None


def test_in_manual_mode_a_joystick_is_armed_centred_and_enabled_and_its_loss_stops():
    seen = driven(Mode.MANUAL, by_hand, 8.2)
    assert seen.reasons[0.3] == "/joy: nothing is received"
    assert seen.reasons[0.9] == "waiting for /joy to be centred"
    assert fastest(seen, 0.0, 1.4) < 0.01
    assert seen.speeds[2.38] > 0.2
    assert fastest(seen, 3.2, 3.4) < 0.01
    assert seen.speeds[4.38] > 0.2  # held again it drives on
    assert "the stick is lost: /joy: silent for" in seen.reasons[4.8]
    assert seen.speeds[6.1] > 0.1  # back within a second, and centred
    assert fastest(seen, 7.4, 8.3) == 0.0
    assert seen.gate.mode == GateMode.STOPPED
    assert seen.gate.reason.startswith("the stick is lost: /joy: silent for")


def held(t):
    if 2.5 <= t < 4.0:
        return 0.0, False
    return None if 5.5 <= t < 7.0 else (0.0, True)


@pytest.mark.slow
def test_with_hold_to_run_the_enable_button_is_a_dead_mans_switch_in_automatic_mode():
    seen = driven(Mode.AUTOMATIC, held, 8.5, hold_to_run=True)
    assert seen.speeds[2.4] > 0.2
    assert seen.reasons[3.0] == "the enable button of /joy is not held"
    assert fastest(seen, 3.5, 4.0) < 0.01
    assert seen.speeds[5.4] > 0.2
    assert seen.reasons[6.5].startswith("/joy: silent for")
    assert fastest(seen, 6.7, 7.0) < 0.01
    assert seen.speeds[8.4] > 0.2
    assert seen.gate.mode == GateMode.AUTOMATIC


def test_a_joystick_topic_needs_a_ros2_robot():
    made = simulated(CORRIDOR, real_time=False)
    with (
        pytest.raises(CohelmError, match="--joy are of a ROS 2 robot: add --ros2"),
        on_topics(made, TopicsConfig(joy="/joy"), print),
    ):
        pass
