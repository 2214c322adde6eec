"""Converts the robot's messages to the page's: unknown numbers become None."""

from __future__ import annotations

import math
from typing import get_args

import numpy as np

from cohelm import __version__
from cohelm.core.types import Pose, Stick
from cohelm.link import bulk_messages as bulk, messages as robot
from cohelm.link.messages import CENTRE
from cohelm.link.station_end import LinkState
from cohelm.station import messages as page
from cohelm.station.robot_link import ReplayLink

MOST_POINTS = 2000
"""Most points of one line sent to a page; a longer line is thinned out."""


def known(value: float) -> float | None:
    """The number rounded to four decimals; None for NaN and infinity."""
    return round(value, 4) if math.isfinite(value) else None


def _where(pose: Pose) -> page.Where:
    return (_or_0(pose.x), _or_0(pose.y), _or_0(pose.psi))


def _or_0(value: float) -> float:
    return known(value) or 0.0


def _ms(seconds: float) -> float | None:
    return round(seconds * 1e3, 1) if math.isfinite(seconds) else None


def welcome(name: str, key: str, stale: float, link: object) -> page.Welcome:
    """The first message to a page."""
    recorded = link if isinstance(link, ReplayLink) else None
    return page.Welcome(
        you=name, key=key, version=__version__, stale_s=stale, centre=CENTRE,
        replay_s=recorded.duration if recorded else None,
    )  # fmt: skip


def hello(message: bulk.Hello) -> page.Robot:
    """The robot's name, outline and camera."""
    angle, x, z, tilt = message.camera
    camera = None
    if all(math.isfinite(v) for v in message.camera):
        camera = page.Camera(field_of_view_rad=angle, mount_x_m=x, mount_z_m=z, tilt_rad=tilt)
    return page.Robot(name=message.name, outline=_points(message.outline), camera=camera)


def _points(points: np.ndarray) -> list[page.Point]:
    """(n, 2) as pairs, thinned out to `MOST_POINTS`, without points that are not finite."""
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) > MOST_POINTS:
        points = points[np.linspace(0, len(points) - 1, MOST_POINTS).astype(int)]
    return [(round(float(x), 3), round(float(y), 3)) for x, y in points]


_LOCALISED = get_args(page.State.model_fields["localised"].annotation)
_VERDICTS = get_args(page.State.model_fields["verdict"].annotation)
_ARMING = get_args(page.State.model_fields["arming"].annotation)
_MODES = get_args(page.ModeName)
_SEVERITIES = get_args(page.Alarm.model_fields["severity"].annotation)
_DOCKING = get_args(page.State.model_fields["docking"].annotation)
_LINES = get_args(page.Line.model_fields["what"].annotation)


def state(s: robot.Status, stamp: float, age: float) -> page.State:
    """The robot's state. stamp: by its clock [s]. age: of the state [s]."""
    limiting = s.guarding.limiting
    reference = _where(s.reference) if all(map(math.isfinite, s.reference)) else None
    estimated = s.localised not in (robot.Localised.UNKNOWN, robot.Localised.LOST)
    sigma = known(s.sigma) if estimated else None
    return page.State(
        t_s=stamp, age_ms=_ms(age) or 0.0, pose=_where(s.pose),
        localised=_LOCALISED[s.localised], sigma_m=sigma, reference=reference,
        twist=(_or_0(s.twist.v), _or_0(s.twist.omega)),
        nominal=(_or_0(s.nominal.v), _or_0(s.nominal.omega)),
        applied=(_or_0(s.applied.v), _or_0(s.applied.omega)),
        why=s.why, verdict=_VERDICTS[s.guarding.verdict],
        stick=(_or_0(s.stick.x), _or_0(s.stick.psi)), arming=_ARMING[s.arming],
        authority=known(s.authority), e_p=known(s.e_p), h_m2=known(s.guarding.h),
        clearance_m=known(s.guarding.clearance),
        limiting=limiting if all(map(math.isfinite, limiting)) else None,
        ahead=_points(np.array(s.ahead, dtype=float).reshape(-1, 2)),
        ahead_step_s=_or_0(s.ahead_step), mode=_MODES[s.mode], stopped=s.stopped,
        speed_cap_mps=known(s.speed_cap), cap_reason=s.cap_reason, recording=s.recording,
        docking=_DOCKING[s.docking], dock=s.dock,
    )  # fmt: skip


def who(lease: robot.Lease, names: dict[int, str], operators: list[str]) -> page.Who:
    """The driver. names: of the robot's clients that are pages of this station."""

    def name(number: int, own_name: str) -> str | None:
        if number == 0:
            return None
        return names.get(number) or f"{own_name or 'unnamed'} ({number})"

    left = known(lease.left)
    return page.Who(
        you_drive=lease.you == lease.driver != 0,
        driver=name(lease.driver, lease.driver_name),
        requester=name(lease.requester, lease.requester_name), requester_client=lease.requester,
        you_request=lease.requester == lease.you != 0,
        left_s=None if left is None else math.ceil(max(left, 0.0)), operators=operators,
    )  # fmt: skip


def alarms(all_: tuple[robot.Alarm, ...]) -> page.Alarms:
    """Alarms that are active or not acknowledged."""
    return page.Alarms(
        alarms=[
            page.Alarm(
                number=a.number, severity=_SEVERITIES[a.severity], text=a.text, active=a.active,
                acknowledged=a.acknowledged,
            )
            for a in all_
        ]
    )  # fmt: skip


def discs(message: robot.Discs) -> page.Discs:
    """Round obstacles."""
    rows = message.rows[np.isfinite(message.rows).all(axis=1)].round(3).tolist()
    return page.Discs(rows=[(r[0], r[1], r[2], r[3], r[4], r[5]) for r in rows])


def line(message: bulk.Polyline) -> page.Line:
    """A line on the map."""
    return page.Line(what=_LINES[message.what], points=_points(message.points))


def docks(message: bulk.Docks) -> page.Docks:
    """The docks of the site."""
    finite = [dock for dock in message.all if all(map(math.isfinite, (*dock.pose, dock.approach)))]
    return page.Docks(
        docks=[
            page.Dock(name=dock.name, pose=_where(dock.pose), approach_m=_or_0(dock.approach))
            for dock in finite
        ]
    )


def link(
    state: LinkState,
    timing: robot.TimingReport | None,
    health: bulk.HealthReport | None,
) -> page.Link:
    """State of the link."""
    return page.Link(
        connected=state.connected, name=state.name, why=state.why,
        round_trip_ms=_ms(state.round_trip), loss=known(state.lost),
        command_age_ms=_ms(timing.command_age) if timing else None,
        offset_ms=_ms(state.offset),
        late_ms=_ms(timing.late) if timing else None,
        battery=known(health.battery) if health else None,
        faults=list(health.faults) if health else [],
    )  # fmt: skip


def records(message: bulk.Records) -> page.Records:
    """The records on the robot."""
    files = [page.RecordFile(name=r.name, bytes=r.size) for r in message.all]
    return page.Records(files=files)


_REQUESTS: dict[str, tuple[robot.RequestKind, int | None]] = {
    "stop": (robot.RequestKind.STOP, 0),
    "reset": (robot.RequestKind.RESET, 0),
    "take": (robot.RequestKind.TAKE, 0),
    "give": (robot.RequestKind.GIVE, None),
    "refuse": (robot.RequestKind.REFUSE, 0),
    "acknowledge": (robot.RequestKind.ACKNOWLEDGE, None),
    "record": (robot.RequestKind.RECORD, 1),
    "record_stop": (robot.RequestKind.RECORD, 0),
    "hold": (robot.RequestKind.MODE, robot.Mode.HOLD),
    "shared": (robot.RequestKind.MODE, robot.Mode.SHARED),
    "automatic": (robot.RequestKind.MODE, robot.Mode.AUTOMATIC),
    "manual": (robot.RequestKind.MODE, robot.Mode.MANUAL),
    "dock": (robot.RequestKind.DOCK, None),
    "undock": (robot.RequestKind.UNDOCK, None),
}


def request_of(do: page.Do) -> tuple[robot.RequestKind, int]:
    """The request to the robot, and its value."""
    what, value = _REQUESTS[do.what]
    return what, do.value if value is None else int(value)


def command_of(stick: page.Stick) -> robot.Command:
    """The command to the robot, still without its requests."""
    return robot.Command(
        Stick(stick.x, stick.psi), stick.valid, stick.armed, robot.Device[stick.device.upper()],
        stick.speed_scale,
    )  # fmt: skip
