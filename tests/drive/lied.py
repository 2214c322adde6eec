"""One drive of a robot with false readings into a wall.

`python -m tests.drive.lied --kind kinematic` drives all of them and prints a table.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cohelm.core.types import Stick
from cohelm.drive.factory import Simulated, simulated
from cohelm.drive.session import Session, SessionConfig
from cohelm.link.messages import Mode
from cohelm.link.operator import Scripted
from cohelm.robot.gate.modes import latched
from tests.drive.faults import CORRIDOR
from tests.drive.lies import LIES, lying

MODES = {"manual": Mode.MANUAL, "shared": Mode.SHARED, "automatic": Mode.AUTOMATIC}
FORWARD = 0.8
"""When the stick is pushed [s]."""
HARMFUL = 0.1
"""A contact of a part of the outline that is faster counts [m/s]."""
FAST = 0.25
"""Of the outline's fastest part: what is slower may be too slow to tell a lie by its motion, and
slower than what a lie is answered with [m/s]."""
_NOT = ("faster than", "the robot does not do more", "collision monitor")
"""Reasons that have nothing to do with a lie."""


class Came(NamedTuple):
    """What came of a lie."""

    lie: str
    mode: str
    kind: str
    mapped: bool
    seed: int
    contact: float
    """The fastest of the outline when in contact, as it came to it [m/s]; 0: none."""
    noticed: float
    """After so long the robot was slowed, held or stopped with a reason [s]; inf: never."""
    reason: str
    drove: float
    """[m]"""
    fast: float
    """For so long it drove faster than FAST while the lie was not noticed [s]."""


def room(kind: str, seed: int) -> tuple[Simulated, float]:
    """A robot before the wall of a room of its seed, and when it lies: before it sets off (seeds
    that four divides), at speed far from the wall, nearer, or about where it has to brake."""
    rng = np.random.default_rng((seed, 0x700))
    ahead, left, right = rng.uniform(3.0, 4.0), rng.uniform(1.2, 2.0), rng.uniform(1.2, 2.0)
    back, notch = rng.uniform(1.5, 2.5), rng.uniform(0.5, 1.5)
    walls = [
        [-back, -right, ahead, -right], [ahead, -right, ahead, left],
        [ahead, left, notch, left], [notch, left, notch, left + 0.8],
        [notch, left + 0.8, notch - 1.0, left + 0.8], [notch - 1.0, left + 0.8, notch - 1.0, left],
        [notch - 1.0, left, -back, left], [-back, left, -back, -right],
    ]  # fmt: skip
    made = simulated(CORRIDOR, kind, real_time=False, seed=seed)
    waypoints = [[0.0, 0.0], [0.5 * ahead, 0.0], [ahead - 0.2, 0.0]]
    reference = made.scenario.reference.model_copy(update={"waypoints_m": waypoints})
    scenario = made.scenario.model_copy(
        update={
            "walls_m": walls, "reference": reference,
            "robot": made.model.model_copy(update={"camera": None}),
        }
    )  # fmt: skip
    before_wall = (ahead - 0.36 - 0.1) / 0.5 + FORWARD
    at = (0.0, 1.8, before_wall - 1.5, before_wall - 0.5)[seed % 4]
    return replace(made, scenario=scenario), at


def drive(lie: str, mode: str, kind: str, mapped: bool, seed: int, seconds: float = 14.0) -> Came:
    """One drive with the stick ahead, into the wall."""
    made, at = room(kind, seed)
    box: list[Session] = []

    def stick(t: float) -> Stick:
        return Stick(0.0 if t < FORWARD else 1.0, 0.0)

    operator = Scripted(stick, lambda: box[0].loop.gated.now() if box else 0.0)
    if mode == "automatic":
        operator = Scripted(lambda _: None, lambda: 0.0)
    plan = SessionConfig(lying(made, lie, at), localise=mapped)
    with Session(plan, operator) as session:
        box.append(session)
        gated, judge = session.gated, _Judge(made.model.reach, at)
        gated._recorder = judge.hear
        gated.propose = judge.watch(gated.propose)
        session.run(lambda loop: judge.look(loop, gated) or gated.now() > seconds, MODES[mode])
        judge.settle(gated.gate)
    return Came(
        lie, mode, kind, mapped, seed, judge.contact, judge.noticed, judge.reason, judge.way,
        judge.fast,
    )  # fmt: skip


class _Judge:
    def __init__(self, reach: float, at: float) -> None:
        self._reach, self._at = reach, at
        self.contact, self.noticed, self.reason, self.way = 0.0, math.inf, "", 0.0
        self.fast = 0.0
        self._before, self._place, self._still = 0.0, None, 0
        self._now = 0.0

    def hear(self, event) -> None:
        """The gate's words."""
        if "FAULTED: " in event.text:
            self._note(event.text.split("FAULTED: ")[1])

    def watch(self, propose):
        def watched(proposal):
            passed = propose(proposal)
            if passed.reason and proposal.twist != passed.applied:
                self._note(passed.reason)
            return passed

        return watched

    def settle(self, gate) -> None:
        """At the end: what was latched before anybody drove."""
        if latched(gate.mode) and self.noticed == math.inf:
            self.noticed, self.reason = 0.0, gate.reason

    def _note(self, reason: str) -> None:
        if reason.startswith(_NOT) or "a change faster" in reason or reason == "idle":
            return
        if self._now >= self._at and self.noticed == math.inf:
            self.noticed, self.reason = self._now - max(self._at, FORWARD), reason

    def look(self, loop, gated) -> bool:
        """After every period; whether all has happened that will."""
        truth = gated.truth()
        before, self._now = self._now, gated.now()
        speed = abs(truth.twist.v) + self._reach * abs(truth.twist.omega)
        if truth.clearance < 0.0 or getattr(truth, "touching", False):
            self.contact = max(self.contact, speed, self._before)
        if self._now > self._at and self.noticed == math.inf and speed > FAST:
            self.fast += self._now - before
        self._before = speed
        if self._place is not None:
            self.way += math.dist(self._place, truth.pose[:2])
        self._place = truth.pose[:2]
        gate = gated.gate
        self._still = self._still + 1 if latched(gate.mode) and speed < 1e-3 else 0
        return self._still > 10


def main() -> None:
    """All, or some; a line of JSON each, then a table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--kind", default="kinematic")
    parser.add_argument("--lies", nargs="*", default=list(LIES))
    parser.add_argument("--modes", nargs="*", default=list(MODES))
    parser.add_argument("--seeds", nargs="*", type=int, default=[0, 1, 2, 3])
    parser.add_argument("--maps", nargs="*", type=int, default=[1, 0])
    given = parser.parse_args()
    for lie in given.lies:
        for mode in given.modes:
            for mapped in given.maps:
                for seed in given.seeds:
                    came = drive(lie, mode, given.kind, bool(mapped), seed)
                    print(json.dumps(came._asdict()), flush=True)
    sys.stdout.flush()


if __name__ == "__main__":
    main()
