"""The Killian Court log of MIT (Bosse and Leonard), where COHELM_KILLIAN names it: `killian.g2o`.

The poses in its ROBOTLASER1 lines are those of the published solution, so a map made from them
proves little. Here the odometry is its sequential edges one after the other, which drift.
"""

import os
from pathlib import Path
from typing import NamedTuple

from cohelm.core.frames import compose
from cohelm.core.types import Pose, Twist
from cohelm.perceive.map.mapping_scans import mapping_scans
from cohelm.perceive.scan.deskew import DeskewedScan
from cohelm.robot.port import Odometry
from cohelm.robot.sensors import Lidar
from cohelm.scenario.worlds.carmen import read_log

GIVEN = os.environ.get("COHELM_KILLIAN")
FILE = Path(GIVEN) if GIVEN else None


class Log(NamedTuple):
    """seen: a sweep for each of `poses`, of the published solution. odometry: the sequential
    edges in a row. loops: pairs of scans and the pose of the second seen from the first."""

    lidar: Lidar
    seen: list[DeskewedScan]
    poses: list[Pose]
    odometry: list[Pose]
    loops: list[tuple[int, int, Pose]]


def read(path: Path) -> Log:
    poses: list[Pose] = []
    steps: dict[int, Pose] = {}
    loops: list[tuple[int, int, Pose]] = []
    for line in path.read_text().splitlines():
        match line.split():
            case ["VERTEX_SE2", _, x, y, psi]:
                poses.append(Pose(float(x), float(y), float(psi)))
            case ["EDGE_SE2", a, b, x, y, psi, *_]:
                edge = Pose(float(x), float(y), float(psi))
                if int(b) == int(a) + 1:
                    steps[int(a)] = edge
                else:
                    loops.append((int(a), int(b), edge))
            case _:
                pass
    chain = [poses[0]]
    for k in range(len(poses) - 1):
        chain.append(compose(chain[-1], steps[k]))
    given = read_log(path)
    odometry = [
        Odometry(scan.stamp, pose, Twist(0.0, 0.0))
        for scan, pose in zip(given.scans, chain, strict=True)
    ]
    lidar = given.lidar.lidar()
    return Log(lidar, mapping_scans(lidar, odometry, given.scans), poses, chain, loops)
