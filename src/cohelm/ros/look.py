"""Finds out what a ROS 2 robot offers (topics, types, rates, mounts, clocks), and what is wrong."""

from __future__ import annotations

import math
import time

from pydantic import ValidationError

from cohelm.core.errors import CohelmError
from cohelm.core.schema import first_fault
from cohelm.robot.model import RobotModel, checked_sight, doubts
from cohelm.ros import clock, depth, mismatch
from cohelm.ros.clock import Clock, estimated
from cohelm.ros.connection import Connection
from cohelm.ros.contact import doubt
from cohelm.ros.found import Allowed, Found
from cohelm.ros.found_lidar import describe
from cohelm.ros.inspection import Inspection
from cohelm.ros.mismatch import ODOMETRY
from cohelm.ros.option_names import OptionNames
from cohelm.ros.port import SENSOR, Endpoint, Transport
from cohelm.ros.topics import Topics

_LEAST = 1.2
"""A robot is looked at for so long at least [s]: discovery takes its time, and controllers a few
commands."""


def look(
    transport: Transport, model: RobotModel, topics: Topics, allowed: Allowed | None = None,
    wait: float = 10.0, way: Connection | None = None,
) -> Found:  # fmt: skip
    """Inspect a robot that stands.

    wait: for what is missing [s]. way: that opened the transport.

    Raises CohelmError with everything that does not fit, one sentence a line.
    """
    allowed = allowed or Allowed()
    if not topics.lock and math.isfinite(allowed.lock_silence):
        raise CohelmError("--lock-timeout, and no lock: name its topic too, or leave out both")
    inspection = Inspection(transport, topics, model)
    end, least = time.monotonic() + wait, time.monotonic() + _LEAST
    try:
        while time.monotonic() < end:
            time.sleep(0.05)
            if time.monotonic() < least or not inspection.enough():
                continue
            framed = allowed.mount_from_model or inspection.framed()
            seen = transport.endpoints()
            listened = any(not one.publishes and one.topic == topics.out for one in seen)
            if framed and listened and not _shared(inspection, seen)[1]:
                break
        return found(inspection, transport, model, allowed, way or Connection())
    finally:
        inspection.end()


def found(
    inspection: Inspection, transport: Transport, model: RobotModel, allowed: Allowed,
    way: Connection,
) -> Found:  # fmt: skip
    """What was received, as one robot. CohelmError for what does not fit."""
    seen, topics = transport.endpoints(), inspection.topics
    if not seen and not inspection.odometry and not any(inspection.scans.values()):
        raise CohelmError(mismatch.no_nodes(transport.name, transport.unseen))
    why = f", because {way.why}" if way.why else ""
    notes = [f"transport: {transport.name}{why}"]
    options = allowed.options
    errors = _missing(inspection, [one.name for one in model.lidars], seen, options)
    notes += [f"{one.model.label}: {one.topic}, {one.kind}" for one in inspection.contacts]
    notes += filter(None, (doubt(one) for one in model.contacts))
    out_type, error = mismatch.base_type(topics.out, allowed.stamped, seen, options)
    errors += [error, "" if allowed.bypass else mismatch.bypass(topics.out, seen, options)]
    notes.append(f"commands to the base: {topics.out}, {out_type}")
    notices: list[tuple[str, str]] = []
    if topics.footprint:
        notices.append(mismatch.footprint(topics.footprint, seen, options))
    if topics.lock:
        known = {one.topic for one in inspection.contacts}
        notices.append(mismatch.lock(topics.lock, seen, known, options))
    notes += [notice for notice, _ in notices]
    errors += [error for _, error in notices]
    twice, shared = _shared(inspection, seen)
    errors += shared or [
        mismatch.frames(topic, inspection.frames(topic), seen) for topic in inspection.scans
    ]
    notes += [
        *twice,
        mismatch.commands(topics.command, topics.out, inspection.command_period(), seen),
    ]
    if any(errors):
        raise CohelmError("\n".join(filter(None, errors)))
    made = _sensed(inspection, model, allowed, out_type, notes)
    return made._replace(connection=way, endpoints=tuple(seen))


def _shared(inspection: Inspection, seen: list[Endpoint]) -> tuple[list[str], list[str]]:
    """Notices and errors about topics with more than one publisher."""
    found = [mismatch.alone(inspection.topics.odom, ODOMETRY, "odometry", seen)]
    found += [mismatch.alone(one, inspection.kinds[one], "LiDAR", seen) for one in inspection.scans]
    return [notice for notice, _ in found if notice], [error for _, error in found if error]


def _missing(
    inspection: Inspection, names: list[str], seen: list[Endpoint], options: OptionNames
) -> list[str]:
    """What did not come, a sentence each. names: of the LiDARs."""
    errors: list[str] = []
    scans = (options.scan, *(f"{options.further_scan}{name}=TOPIC" for name in names[1:]))
    needed = [(inspection.topics.odom, ODOMETRY, inspection.odometry, options.odom)]
    needed += [
        (topic, inspection.kinds[topic], rows, option)
        for option, (topic, rows) in zip(scans, inspection.scans.items(), strict=True)
    ]
    for topic, kind, came, option in needed:
        if len(came) < 3:
            damage = inspection.damage.get(topic, "")
            errors.append(mismatch.nothing_received(topic, kind, SENSOR, option, seen, damage))
    errors += [
        mismatch.no_camera_info(topic, depth.info_topic(topic), seen)
        for topic, rows in inspection.infos.items()
        if not rows and any(one.publishes and one.topic == topic for one in seen)
    ]  # fmt: skip
    silent = {o.topic: o for o in inspection.contacts if o.topic not in inspection.touched}
    for topic, one in sorted(silent.items()):
        damage = inspection.damage.get(topic, "")
        option = f"{options.contact}{one.model.name}=TOPIC"
        errors.append(mismatch.nothing_received(topic, one.kind, SENSOR, option, seen, damage))
    return errors


def _sensed(
    inspection: Inspection, model: RobotModel, allowed: Allowed, out_type: str, notes: list[str]
) -> Found:  # fmt: skip
    """What the sensors are, and when their stamps are of."""
    topics = inspection.topics
    inspection.settle_time()
    if inspection.simulated:
        notes.append(f"simulated time: {clock.TOPIC}, {inspection.clock.rate:.2f} of the wall's")
    odom_clock = estimated(
        inspection.ages(inspection.odometry), topics.odom, allowed.clock, allowed.options.clock
    )
    odom_rate = inspection.rate(inspection.odometry)
    rates = {topics.odom: odom_rate, **{k: inspection.rate(v) for k, v in inspection.scans.items()}}
    if errors := [why for topic, rate in rates.items() if (why := mismatch.seldom(topic, rate))]:
        raise CohelmError("\n".join(errors))
    notes.append(
        f"odometry: {topics.odom}, {odom_rate:.0f} Hz, {inspection.odom()} -> {inspection.body()}"
    )
    described = (model.lidar, *model.further_lidars)
    lidars = [
        describe(inspection, topic, configured, allowed)
        for topic, configured in zip(inspection.scans, described, strict=True)
    ]
    notes += [one.note for one in lidars]
    notes += filter(None, (mismatch.slow(one.found.topic, one.model.rate_hz) for one in lidars))
    clocks = [(topics.odom, odom_clock), *((one.found.topic, one.found.clock) for one in lidars)]
    notes += [_differs(name, one) for name, one in clocks if one.ahead]
    notes += [
        f"{one.found.topic} is stamped at the end of each scan, and taken so"
        for one in lidars if one.found.stamped_at_end
    ]  # fmt: skip
    first, *further = (one.model.model_dump() for one in lidars)
    keys = model.model_dump() | {
        "lidar": first, "further_lidars": further,
        "odometry": model.odometry.model_dump() | {"rate_hz": odom_rate},
    }  # fmt: skip
    try:
        made = RobotModel.model_validate(keys)
    except ValidationError as error:
        said = f"{', '.join(inspection.scans)} and /tf_static"
        raise CohelmError(f"{said} do not fit the robot: {first_fault(error)}") from error
    if not inspection.simulated:
        notes += doubts(made)
    checked_sight(made)
    return Found(
        topics, made, out_type, inspection.body(), inspection.odom(), odom_clock,
        tuple(one.found for one in lidars), inspection.command_period(), tuple(notes),
        bypass=allowed.bypass, options=allowed.options,
        lock_silence=allowed.lock_silence, simulated=inspection.simulated,
    )  # fmt: skip


def _differs(topic: str, one: Clock) -> str:
    direction = "ahead of" if one.ahead > 0.0 else "behind"
    return (
        f"the clock that stamps {topic} is {abs(one.ahead):.3f} s {direction} this machine's: "
        "taken into account, up to the time a message is under way"
    )
