"""What makes the robot in the gate process."""

import pickle
import subprocess
import sys
from pathlib import Path

import pytest

import cohelm
from cohelm.core.errors import CohelmError
from cohelm.drive.factory import own_robot, simulated
from cohelm.robot.keep.gated_robot import rules
from cohelm.robot.keep.serve import serve

NEEDED = {"core", "law", "robot", "sim"}
"""Rooms; of the law what places obstacles and attackers, for the compiled world."""
MAKES = """
import pickle, sys
for _, make, _ in pickle.loads(sys.stdin.buffer.read()):
    make().close()
    print(*{name.split(".")[1] for name in sys.modules if name.startswith("cohelm.")})
"""


def test_the_gate_process_imports_nothing_that_decides_where_to_drive():
    """One process makes either robot, first the kinematic one."""
    either = [simulated("lab-guard", kind) for kind in ("kinematic", "twin")]
    sent = pickle.dumps([(serve, made.maker(), rules(made.model, 0.02)) for made in either])
    called = [sys.executable, "-c", MAKES]
    said = subprocess.run(called, input=sent, capture_output=True, check=True).stdout
    rooms = [{*line.decode().split()} for line in said.splitlines()]
    assert len(rooms) == 2
    assert all(some <= NEEDED for some in rooms), rooms


class Cart(cohelm.Robot):
    """A robot that is only named here."""


@pytest.mark.parametrize("site", ["", Path()], ids=repr)
def test_an_empty_site_is_none_that_sets_a_robot_off(site):
    """As of a variable that is not set: a real robot stands where no site is named, and drives
    where one is."""
    with pytest.raises(CohelmError, match="is a folder"):
        own_robot(Cart, site, "sally")
