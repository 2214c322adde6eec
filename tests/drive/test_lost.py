"""Localization is lost during a manual drive on the twin."""

import math
from dataclasses import replace

import numpy as np

from cohelm.core.types import Stick
from cohelm.drive.factory import simulated
from cohelm.drive.session import Session, SessionConfig
from cohelm.law import verdict
from cohelm.link.messages import AlarmKind, Localised, Mode
from cohelm.link.operator import Scripted
from cohelm.loop.speed_caps import MAX_LOST_SPEED
from cohelm.perceive.localize.map_from_geometry import map_from_geometry
from cohelm.robot.gate.modes import GateMode
from tests.drive.faults import CORRIDOR

ROOM = [[-2.5, 17.2, 4.5, 20.0], [4.5, 20.0, -2.5, 22.8], [-2.5, 22.8, -2.5, 17.2]]
"""A room that is not on the map, 20 m beside the corridor; no two of its walls are at the angles of
the corridor's, so that the robot can not take it for a part of that."""
PUSHED, FORWARD, ASIDE, END = 3.0, 6.4, 13.2, 17.0


def stick(t: float) -> Stick:
    """Centred at first, and for a while when it is lost; then ahead into the wall, then away."""
    if t < FORWARD:
        return Stick(0.0, 0.0)
    return Stick(0.9, 0.0) if t < ASIDE else Stick(-0.8, 0.3)


def test_a_lost_robot_waits_and_can_still_be_driven_with_the_guard_on_the_scan():
    made = simulated(CORRIDOR, "twin", real_time=False, seed=3)
    walls = made.scenario.walls_m
    known = map_from_geometry(np.array(walls), made.start)
    scenario = made.scenario.model_copy(update={"walls_m": [*walls, *ROOM]})
    blind = made.model.model_copy(update={"camera": None})
    made = replace(made, scenario=scenario.model_copy(update={"robot": blind}))
    box: list[Session] = []
    operator = Scripted(stick, lambda: box[0].loop.gated.now() if box else 0.0)
    with Session(SessionConfig(made, known=known), operator) as session:
        box.append(session)
        gated, loop = session.gated, session.loop

        def drive(until: float) -> list:
            truths = []
            session.run(
                lambda loop: truths.append(gated.truth()) or loop.gated.now() >= until - 1e-9,
                Mode.SHARED if until == PUSHED else Mode.HOLD,
            )
            return truths

        assert abs(drive(PUSHED)[-1].twist.v) > 0.3  # the controller drives
        gated._robot.push(0.0, 20.0, 0.7)
        drive(PUSHED + 3.0)  # scans and odometry disagree: it is held, and looks on standing
        assert loop.seen.lost
        tau = loop.driver.pilot.state.clock
        waits = drive(FORWARD)
        assert loop.seen.lost
        assert loop.driver.pilot.state.clock == tau  # the reference waits
        assert math.dist(waits[0].pose[:2], waits[-1].pose[:2]) < 0.05
        assert operator.statuses[-1].localised == Localised.LOST
        said = operator.statuses[-1]  # the plausibility monitor's limit, which is the lower one
        assert said.speed_cap < MAX_LOST_SPEED
        assert said.cap_reason.startswith("after a sudden change of the scan")
        ahead = drive(ASIDE)
        assert max(abs(truth.twist.v) for truth in ahead) < MAX_LOST_SPEED + 0.02
        assert math.dist(ahead[0].pose[:2], ahead[-1].pose[:2]) > 0.5  # the person drives
        assert loop.seen.lost
        assert abs(ahead[-1].twist.v) < 0.02  # and stands before the wall, stick ahead
        assert loop.decision.verdict != verdict.UNTOUCHED
        away = drive(END)
        assert math.dist(away[0].pose[:2], away[-1].pose[:2]) > 0.2
        assert away[-1].least_moving > 0.01
        assert gated.gate.mode == GateMode.SHARED
        alarms = operator.statuses[-1].alarms
        assert [alarm.kind for alarm in alarms if "lost" in alarm.text] == [AlarmKind.LOST]
