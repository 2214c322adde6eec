"""A reset on a topic releases what was latched when it came, once, and nothing else."""

from cohelm.robot.gate.gate import Gate
from cohelm.robot.gate.modes import GateMode
from cohelm.ros.reset import ResetRequest

DRIVING = Gate(GateMode.AUTOMATIC)
STOPPED = Gate(GateMode.STOPPED, "the operator stopped it")
FAULTED = Gate(GateMode.FAULTED, "the odometry jumped (and stopped: the operator stopped it)")


def test_a_reset_after_the_stop_counts_once():
    made = ResetRequest()
    assert made.due(STOPPED, 1.0) is None
    made.request(1.5)
    assert made.due(STOPPED, 2.0) == ""
    assert made.due(STOPPED, 3.0) is None


def test_a_reset_from_before_the_stop_or_its_newest_reason_does_not_count():
    made = ResetRequest()
    assert made.due(DRIVING, 1.0) is None
    made.request(1.01)  # published while it drove, and taken in with the stop
    assert made.due(STOPPED, 1.02) == "it came before the stop: the operator stopped it"
    assert made.due(STOPPED, 1.04) is None
    made.request(2.0)
    assert made.due(FAULTED, 2.02).startswith("it came before the stop: the odometry jumped")
    made.request(3.0)
    assert made.due(FAULTED, 3.02) == ""
    assert made.due(Gate(GateMode.IDLE), 3.04) is None
    assert made.due(STOPPED, 4.0) is None  # the same reason again is another stop
    made.request(3.9)
    assert made.due(STOPPED, 4.02) == "it came before the stop: the operator stopped it"


def test_a_reset_while_nothing_is_latched_is_not_kept():
    made = ResetRequest()
    made.request(1.0)
    assert made.due(DRIVING, 1.01) is None
    assert made.due(STOPPED, 1.5) is None
