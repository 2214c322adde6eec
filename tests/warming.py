"""What most tests need compiled, in two halves: each begins with what the other does not need, or
not before it is there.
"""

import numpy as np

from cohelm.core.obstacles import Obstacles
from cohelm.core.types import Pose, Twist
from cohelm.drive.factory import simulated
from cohelm.drive.session import Session, SessionConfig
from cohelm.perceive.map.mapper import Mapper
from cohelm.perceive.map.mapping_scans import mapping_scans
from cohelm.perceive.map.raster import raster
from cohelm.perceive.pipeline import warm_up
from cohelm.pilot.safety_filter import SafetyFilter
from cohelm.plan.recovery import recovery_move
from cohelm.plan.recovery_search import search_recovery
from cohelm.robot.clock import SteppedClock
from cohelm.scenario.load import robot
from cohelm.sim.kinematic import Kinematic
from cohelm.sim.twin.robot import Twin
from cohelm.study.campaign import suites
from cohelm.study.campaign.worker import chunk
from tests.perceive import drives
from tests.pilot.drives import drive
from tests.ros.fuzz import with_clouds


def driven(suite: str, law: str, plant: str = "kinematic") -> None:
    """One episode of a suite."""
    (row,) = chunk(suites.suite(suite, 1, None, plant), law, (6,))
    if row.fault:
        raise SystemExit(row.fault)


def started() -> None:
    """All that a drive compiles before the robot is ready."""
    with Session(SessionConfig(simulated("lab-guard", real_time=False))) as session:
        session.end("warm")


def mapped() -> None:
    """A lap with a loop, which is closed."""
    lidar = drives.LIDAR.lidar()
    moments = list(drives.drive(*drives.along([*drives.TOUR, *drives.TOUR[:4]], 1.5)))
    scans = {seen.number: seen for m in moments if (seen := m.readings.scan) is not None}
    mapper = Mapper(lidar)
    views = mapping_scans(lidar, [m.readings.odometry for m in moments], list(scans.values()))
    for view in views:
        mapper.add(view)
    raster(mapper.finished().poses, [view.points for view in views], lidar.mount, 0.05)


def freed() -> None:
    """A way out of a tight place."""
    here, walls = Pose(0.0, 0.0, 0.0), np.array([[0.0, 0.4], [0.0, -0.4]])
    for move in (recovery_move, search_recovery):
        move(here, 3.0, walls, robot("sally").outline)


def first() -> None:
    """The law and the planner, in rooms driven on exact arcs and through the loop on the twin."""
    freed()
    driven("random", "guard")
    driven("random", "guard", "twin")
    driven("heights", "guard", "twin")
    started()


def more() -> None:
    """Perception and mapping."""
    warm_up(robot("sally"), True)
    for several in (robot("sally-rear"), with_clouds(robot("sally-rear"))):
        warm_up(several, False)  # two LiDARs, and three, are other types to the compiler
    mapped()
    driven("adversary", "guard")
    driven("random", "none")
    drive([[0, 0], [1, 0], [2, 0]], [(1.0, 0.1, 0.1)], [(2.0, 0.4, 2.0, 2.0)], seconds=5.0)
    still = Twist(0.0, 0.0)
    SafetyFilter(robot("sally"), 0.02)(Pose(0.0, 0.0, 0.0), still, still, Obstacles())
    Kinematic(robot("sally"), clock=SteppedClock()).read()
    Twin(robot("sally"), clock=SteppedClock()).picture(32, 24, kind="rays")
