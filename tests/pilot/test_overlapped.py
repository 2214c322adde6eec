"""A robot into which somebody has walked holds still until he is off it again."""

import math

import numpy as np
from hypothesis import given, settings, strategies as st

from cohelm.core.types import CENTRED, Pose, Stick, Twist, disc
from cohelm.law.guard.surroundings import surroundings
from cohelm.law.reference import through
from cohelm.pilot.pilot import Pilot
from cohelm.robot.achievable import achievable
from cohelm.robot.kinematics import arc
from cohelm.sim.world import outline_clearance
from tests.pilot.drives import DT, SALLY, SETTINGS

NOWHERE = np.empty((0, 4))


@given(
    st.floats(-math.pi, math.pi), st.floats(-0.25, 0.25, allow_subnormal=False),
    st.floats(0.1, 2.0), st.floats(0.2, 0.5), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0),
    st.booleans(),
)  # fmt: skip
@settings(max_examples=40, deadline=None)
def test_an_obstacle_in_the_footprint_holds_the_robot_whatever_the_command(
    bearing, aside, speed, radius, x, y, leads
):
    """He comes from anywhere at a robot that stands, and goes on through it, as in a campaign; it
    would follow its route, make way, get out of a tight spot, or do what the stick says."""
    pilot = Pilot(through([(0.0, 0.0), (3.0, 0.0), (6.0, 0.0)], 0.5), SETTINGS)
    pose, twist, held = Pose(0.0, 0.0, 0.0), Twist(0.0, 0.0), 0
    c, s = math.cos(bearing), math.sin(bearing)
    far = 0.1  # he sets out inside the footprint
    for k in range(60):
        at = far - speed * k * DT
        who = disc(c * at - s * aside, s * at + c * aside, radius, radius, -c * speed, -s * speed)
        seen = surroundings([who], [1.0])
        clearance = outline_clearance(pose, SALLY.outline, 0.5, seen.discs, NOWHERE, 9.0)
        if k % 10 == 0:
            pilot.take(pilot.plan(pose, twist, seen), pose, twist)
        stick = Stick(x, y) if leads else CENTRED
        d = pilot.step(k * DT, pose, twist, stick, seen)
        twist = achievable(d.safe, twist, SETTINGS.limits, DT)
        if clearance < 0.0:
            assert twist == Twist(0.0, 0.0)
            held += 1
        pose = arc(pose, twist, DT)
    assert held > 3
