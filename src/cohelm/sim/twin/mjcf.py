"""MuJoCo's model of a robot and the world around it, as MJCF text.

The floor is z = 0, the world frame that of the scenario. Groups of geoms: FLOOR, WALL, THING are
drawn; SOLID is what a disc collides as; ROBOT is drawn in pictures from outside only. The body
meets walls and things, the wheels meet the floor only: a wheel may stand out of the footprint.

Two choices carry the driving. Wheels are ellipsoids, which touch the floor in one point: cylinders
scrub in a turn. The integrator is `discrete`, which solves contacts and servos together: with
`implicitfast` the wheels' servos and the friction at the floor each ignore the other within a step,
and the robot surges beside its wheels by several per cent.
"""

from __future__ import annotations

import math
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from cohelm.core.errors import CohelmError
from cohelm.core.types import RADIUS, Floats, Ints, X, Y
from cohelm.robot.model import RobotModel
from cohelm.robot.sensors import CameraModel
from cohelm.sim.grid import Grid
from cohelm.sim.twin.settings import TwinModel

FLOOR, WALL, THING, SOLID, ROBOT = range(5)
"""Groups of geoms."""

WALL_HEIGHT = 1.5
PERSON_HEIGHT = 1.7
_HALF_THICK = 0.001  # of a wall, which is a line in the scenario [m]
_GAP = 0.03  # between body and floor [m]
_CONE = 0.16  # things at rest with at most this radius are drawn as cones of 0.5 m [m]
_MOST = 20_000  # boxes and cylinders; MuJoCo gets slow to compile beyond
_LEAST = 1e-3  # MuJoCo wants sizes above 0 [m]
GRAVITY = 9.81
_ABOVE = 30.0  # vertical angle of view of the camera above, for pictures of 2 : 1 [deg]


def mjcf(
    robot: RobotModel, settings: TwinModel, step: float, discs: Floats, moving: list[int],
    walls: Floats, grid: Grid,
) -> str:  # fmt: skip
    """The whole model.

    step: of physics [s]. discs: (n, 6) at the start; those in `moving` become mocap bodies, in
    that order. walls: (s, 4). Raises CohelmError where there is more than physics can bear.
    """
    cells = rectangles(grid.free == 0)
    count = len(discs) + len(walls) + len(cells)
    if count > _MOST:
        raise CohelmError(
            f"the twin's world would have {count} boxes and cylinders, at most {_MOST} can be: "
            "use a smaller or coarser map, or the kinematic plant"
        )
    resting = [i for i in range(len(discs)) if i not in set(moving)]
    radii = sorted({float(discs[i, RADIUS]) for i in resting if discs[i, RADIUS] <= _CONE})
    camera = robot.camera or CameraModel()
    # znear and zfar are parts of the extent: of a large world's, walls nearby would not be drawn
    return f"""<mujoco model="{escape(robot.name, {'"': "&quot;"})}">
<compiler angle="radian"/>
<option timestep="{step}" integrator="discrete" jacobian="dense" cone="elliptic"
 impratio="10" gravity="0 0 -{GRAVITY}"/>
<statistic extent="1"/>
<visual><global offwidth="{max(camera.width, 1280)}" offheight="{max(camera.height, 960)}"/>
<map znear="0.02" zfar="60"/><quality offsamples="2"/>
<headlight ambient="0.55 0.55 0.55" diffuse="0.25 0.25 0.25"/></visual>
<default><geom contype="0" conaffinity="0"/></default>
<asset><texture name="sky" type="skybox" builtin="gradient" rgb1="0.72 0.82 0.92"
 rgb2="0.45 0.6 0.8" width="32" height="32"/>
<texture name="tiles" type="2d" builtin="checker" rgb1="0.66 0.66 0.63" rgb2="0.57 0.57 0.55"
 width="128" height="128"/>
<material name="tiles" texture="tiles" texrepeat="1 1" texuniform="true"/>
{"".join(_cone(radius) for radius in radii)}{_prism(robot)}</asset>
<worldbody><light directional="true" dir="0.3 0.5 -1" diffuse="0.5 0.5 0.5" castshadow="false"/>
{_above(discs, walls, grid)}
<geom name="floor" type="plane" size="0 0 1" material="tiles" contype="1" group="{FLOOR}"
 friction="{settings.friction} 0.005 0.0001"/>
{_walls(walls)}{_map(grid, cells)}{"".join(_resting(discs[i]) for i in resting)}
{"".join(_mover(k, discs[i]) for k, i in enumerate(moving))}
{_robot(robot, settings, camera)}
</worldbody>
{_drives(robot, settings)}
<sensor><contact geom1="body" num="1" data="found force" reduce="maxforce"/></sensor>
</mujoco>"""


def _above(discs: Floats, walls: Floats, grid: Grid) -> str:
    """A camera that has the whole world in view from above, y upwards."""
    ends = walls.reshape(-1, 2)
    corners = [(float(x), float(y)) for x, y in (*ends, *discs[:, :2])] or [
        (-3.0, -3.0),
        (3.0, 3.0),
    ]
    rows, columns = grid.free.shape
    c, s = math.cos(grid.origin.psi), math.sin(grid.origin.psi)
    for i, j in ((0, 0), (0, rows), (columns, 0), (columns, rows)) if rows else ():
        u, v = grid.resolution * i, grid.resolution * j
        corners.append((grid.origin.x + c * u - s * v, grid.origin.y + s * u + c * v))
    xs, ys = [x for x, _ in corners], [y for _, y in corners]
    wide, tall = max(xs) - min(xs) + 2.0, max(ys) - min(ys) + 2.0
    half = math.radians(0.5 * _ABOVE)
    high = 0.5 * max(tall, 0.5 * wide) / math.tan(half) + WALL_HEIGHT
    return (
        f'<camera name="above" pos="{0.5 * (max(xs) + min(xs))} {0.5 * (max(ys) + min(ys))} '
        f'{high}" fovy="{_ABOVE}"/>'
    )


def _cone(radius: float) -> str:
    wide = max(radius, _LEAST)
    return f'<mesh name="cone{radius!r}" builtin="cone" params="24 0" scale="{wide} {wide} 0.25"/>'


def _walls(walls: Floats) -> str:
    made: list[str] = []
    for x1, y1, x2, y2 in walls.tolist():
        half = 0.5 * math.hypot(x2 - x1, y2 - y1)
        yaw = math.atan2(y2 - y1, x2 - x1)
        made.append(_box(0.5 * (x1 + x2), 0.5 * (y1 + y2), yaw, max(half, _LEAST), _HALF_THICK))
    return "\n".join(made)


def _map(grid: Grid, cells: Ints) -> str:
    side = grid.resolution
    c, s = math.cos(grid.origin.psi), math.sin(grid.origin.psi)
    made: list[str] = []
    for row, column, row_end, column_end in cells.tolist():
        x, y = 0.5 * side * (column + column_end), 0.5 * side * (row + row_end)
        made.append(
            _box(
                grid.origin.x + c * x - s * y, grid.origin.y + s * x + c * y, grid.origin.psi,
                0.5 * side * (column_end - column), 0.5 * side * (row_end - row),
            )
        )  # fmt: skip
    return "\n".join(made)


def _box(x: float, y: float, yaw: float, half_x: float, half_y: float) -> str:
    high = 0.5 * WALL_HEIGHT
    return (
        f'<geom type="box" pos="{x} {y} {high}" euler="0 0 {yaw}" size="{half_x} {half_y} {high}" '
        f'conaffinity="2" group="{WALL}" rgba="0.86 0.84 0.78 1"/>'
    )


def _resting(disc: Floats) -> str:
    """A cylinder to bump into; a small one looks like a traffic cone."""
    x, y, radius = float(disc[X]), float(disc[Y]), float(disc[RADIUS])
    cone = radius <= _CONE
    high = 0.25 if cone else 0.5
    solid = (
        f'<geom type="cylinder" pos="{x} {y} 0.5" size="{max(radius, _LEAST)} 0.5" '
        f'conaffinity="2" group="{SOLID}"/>'
    )
    look = f'type="mesh" mesh="cone{radius!r}"' if cone else f'type="cylinder" size="{radius} 0.5"'
    colour = "1 0.42 0.05 1" if cone else "0.55 0.42 0.35 1"
    return f'{solid}<geom {look} pos="{x} {y} {high}" group="{THING}" rgba="{colour}"/>\n'


def _mover(k: int, disc: Floats) -> str:
    """A pedestrian: soft, on its own path, and never pushed aside."""
    radius, high = max(float(disc[RADIUS]), _LEAST), 0.5 * PERSON_HEIGHT
    colour = ("0.15 0.3 0.75 1", "0.65 0.15 0.2 1", "0.15 0.5 0.3 1", "0.5 0.25 0.6 1")[k % 4]
    return (
        f'<body name="mover{k}" mocap="true" pos="{disc[X]} {disc[Y]} 0">'
        f'<geom type="cylinder" pos="0 0 {high}" size="{radius} {high}" conaffinity="2" '
        f'group="{SOLID}" solref="0.06 1"/>'
        f'<geom type="cylinder" pos="0 0 0.72" size="{radius} 0.72" group="{THING}" '
        f'rgba="{colour}"/>'
        f'<geom type="sphere" pos="0 0 1.58" size="{min(radius, 0.13)}" group="{THING}" '
        f'rgba="0.85 0.68 0.55 1"/></body>\n'
    )


def _robot(robot: RobotModel, settings: TwinModel, camera: CameraModel) -> str:
    """Body, two wheels and two casters, the axle's middle at the world's origin."""
    outline, radius = robot.outline, robot.wheel_radius_m
    low, high = outline.min(axis=0), outline.max(axis=0)
    length, width, middle = high[0] - low[0], high[1] - low[1], 0.5 * (low + high)
    wheel = 0.03 * robot.mass_kg
    rest = robot.mass_kg - 2.0 * wheel
    tall = robot.height_m
    inertia = (
        f"{rest * (width**2 + tall**2) / 12} {rest * (length**2 + tall**2) / 12} "
        f"{rest * (length**2 + width**2) / 12}"
    )
    wide = min(0.02, 0.2 * robot.track_m)
    made = [
        '<body name="robot"><freejoint/>',
        f'<inertial pos="{0.3 * middle[0]} {0.3 * middle[1]} {0.35 * tall}" mass="{rest}" '
        f'diaginertia="{inertia}"/>',
        _body(robot),
        f'<camera name="camera" pos="{camera.mount_x_m} 0 {camera.mount_z_m}" '
        f'xyaxes="0 -1 0 {math.sin(math.radians(camera.tilt_deg))} 0 '
        f'{math.cos(math.radians(camera.tilt_deg))}" '
        f'fovy="{camera.field_of_view_deg}"/>',
    ]
    made += [
        f'<geom type="cylinder" pos="{lidar.mount_x_m} {lidar.mount_y_m} {tall + 0.03}" '
        f'size="0.045 0.03" group="{ROBOT}" rgba="0.1 0.1 0.1 1"/>'
        for lidar in robot.lidars
    ]
    made.append(
        f'<geom type="box" pos="{high[0] - 0.03} {middle[1]} {tall}" '
        f'size="0.02 {0.35 * width} 0.004" group="{ROBOT}" rgba="0.95 0.9 0.3 1"/>'
    )
    made.append('<camera name="behind" pos="-1.8 0 1.5" xyaxes="0 -1 0 0.5 0 1" fovy="60"/>')
    ball = min(0.04, 0.6 * radius)
    for name, x in (("front", 0.8 * high[0]), ("rear", 0.8 * low[0])):
        made.append(
            f'<geom name="{name}" type="sphere" pos="{x} 0 {ball}" size="{ball}" condim="1" '
            f'priority="1" solref="0.03 1" conaffinity="1" group="{ROBOT}" rgba="0.2 0.2 0.2 1"/>'
        )
    drag = rolling_torque(robot, settings)
    for name, side in (("left", 1.0), ("right", -1.0)):
        made.append(
            f'<body name="{name}" pos="0 {0.5 * side * robot.track_m} {radius}">'
            f'<joint name="{name}" type="hinge" axis="0 1 0" frictionloss="{drag}"/>'
            f'<geom type="ellipsoid" size="{radius} {wide} {radius}" mass="{wheel}" '
            f'conaffinity="1" friction="{settings.friction} 0.005 0.0001" group="{ROBOT}" '
            f'rgba="0.15 0.15 0.15 1"/></body>'
        )
    return "\n".join([*made, "</body>"])


def _bottom(robot: RobotModel) -> float:
    return min(_GAP, 0.2 * robot.height_m)


def _is_box(outline: Floats) -> bool:
    low, high = outline.min(axis=0), outline.max(axis=0)
    return len(outline) == 4 and bool(((outline == low) | (outline == high)).all())


def _prism(robot: RobotModel) -> str:
    """The footprint between the body's bottom and top as a convex mesh, unless it is a box."""
    if _is_box(robot.outline):
        return ""
    corners = [
        f"{x} {y} {z}" for z in (_bottom(robot), robot.height_m) for x, y in robot.outline.tolist()
    ]
    return f'<mesh name="body" vertex="{" ".join(corners)}"/>'


def _body(robot: RobotModel) -> str:
    outline, bottom, top = robot.outline, _bottom(robot), robot.height_m
    common = f'name="body" contype="2" mass="0" group="{ROBOT}" rgba="0.1 0.5 0.3 1"'
    if not _is_box(outline):
        return f'<geom type="mesh" mesh="body" {common}/>'
    middle = 0.5 * (outline.min(axis=0) + outline.max(axis=0))
    half = 0.5 * (outline.max(axis=0) - outline.min(axis=0))
    return (
        f'<geom type="box" pos="{middle[0]} {middle[1]} {0.5 * (bottom + top)}" '
        f'size="{half[0]} {half[1]} {0.5 * (top - bottom)}" {common}/>'
    )


def _drives(robot: RobotModel, settings: TwinModel) -> str:
    """Velocity servos."""
    gain, most = servo_gain(robot, settings), torque_limit(robot, settings)
    drives = "".join(
        f'<velocity joint="{name}" kv="{gain}" forcerange="{-most} {most}"/>'
        for name in ("left", "right")
    )
    return f"<actuator>{drives}</actuator>"


def servo_gain(robot: RobotModel, settings: TwinModel) -> float:
    """Torque per speed error: a wheel with its half of the robot gets this lag [N m s]."""
    return _wheel_inertia(robot) / settings.wheel_lag_s


def rolling_torque(robot: RobotModel, settings: TwinModel) -> float:
    """What it takes to keep a wheel rolling [N m]."""
    weight = 0.5 * robot.mass_kg * GRAVITY
    return settings.rolling_resistance * weight * robot.wheel_radius_m


def _wheel_inertia(robot: RobotModel) -> float:
    """What a drive has to turn: its wheel and half of the robot, as seen at the wheel [kg m^2]."""
    radius = robot.wheel_radius_m
    return (0.5 + 0.4 * 0.03) * robot.mass_kg * radius * radius


def torque_limit(robot: RobotModel, settings: TwinModel) -> float:
    """Largest torque of a drive [N m]; with no limit of acceleration, what makes a wheel slip."""
    limits, radius = robot.limits, robot.wheel_radius_m
    most = [settings.friction * GRAVITY]
    if limits.wheel_acceleration_mps2 is not None:
        most.append(limits.wheel_acceleration_mps2)
    elif limits.acceleration_mps2 is not None:
        most.append(limits.acceleration_mps2)
    return (
        rolling_torque(robot, settings)
        + settings.torque_margin * _wheel_inertia(robot) * min(most) / radius
    )


def rectangles(solid: NDArray[np.bool_]) -> Ints:
    """Rectangles that cover exactly the solid cells, once each: physics has few boxes to look at.

    (k, 4): first row, first column, and the row and column after the last. Runs along a row grow
    upwards over the rows above as long as these have the very same run.
    """
    rows = len(solid)
    edge = np.zeros((rows, 1), dtype=np.int8)
    steps = np.diff(np.hstack((edge, solid.astype(np.int8), edge)), axis=1)
    found: list[tuple[int, int, int, int]] = []
    growing: dict[tuple[int, int], int] = {}
    for row in range(rows):
        starts, ends = np.flatnonzero(steps[row] > 0), np.flatnonzero(steps[row] < 0)
        runs = set(zip(starts.tolist(), ends.tolist(), strict=True))
        for run in sorted(growing.keys() - runs):
            found.append((growing.pop(run), run[0], row, run[1]))
        for run in sorted(runs - growing.keys()):
            growing[run] = row
    found += [(first, run[0], rows, run[1]) for run, first in sorted(growing.items())]
    return np.array(found, dtype=np.int64).reshape(-1, 4)
