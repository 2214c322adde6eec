"""Finds out what a ROS 2 robot offers: topics, types, rates, mounts, clocks; and what is amiss."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from cohelm.core.errors import CohelmError
from cohelm.robot.model import RobotModel
from cohelm.ros import clock, depth, mismatch
from cohelm.ros.clock import Clock, estimated
from cohelm.ros.connection import Connection
from cohelm.ros.found import Allowed, Found
from cohelm.ros.found_lidar import describe
from cohelm.ros.inspection import Inspection
from cohelm.ros.mismatch import ODOMETRY, TWIST
from cohelm.ros.port import COMMAND, SENSOR, Endpoint, Transport
from cohelm.ros.topics import Topics

_LEAST = 1.2
"""A robot is looked at for so long at least [s]: discovery takes its time, and controllers a few
commands."""


def look(
    transport: Transport, model: RobotModel, topics: Topics, allowed: Allowed | None = None,
    wait: float = 10.0, drives: bool = True, over: Callable[[], bool] = lambda: False,
    way: Connection | None = None,
) -> Found:  # fmt: skip
    """Look at a robot that stands.

    wait: for what is missing [s]. drives: whether the base is to be driven from here; else nobody
    has to listen to `topics.out`. over: whether to give up. way: that opened the transport.

    Raises CohelmError with everything that does not fit, one sentence a line.
    """
    allowed = allowed or Allowed()
    if not topics.lock and math.isfinite(allowed.lock_silence):
        raise CohelmError("--lock-timeout, and no lock: name its topic too, or leave out both")
    heard = Inspection(transport, topics, model)
    end, least = time.monotonic() + wait, time.monotonic() + _LEAST
    try:
        while time.monotonic() < end and not over():
            time.sleep(0.05)
            if time.monotonic() < least or not heard.enough():
                continue
            framed = allowed.mount_from_model or heard.framed()
            listened = not drives or any(
                not one.publishes and one.topic == topics.out for one in transport.endpoints()
            )
            if framed and listened and not _shared(heard, transport.endpoints())[1]:
                break
        return found(heard, transport, model, allowed, drives, way)
    finally:
        heard.end()


def found(
    heard: Inspection, transport: Transport, model: RobotModel, allowed: Allowed, drives: bool,
    way: Connection | None = None,
) -> Found:  # fmt: skip
    """What was heard, as one robot. CohelmError for what does not fit."""
    seen, topics = transport.endpoints(), heard.topics
    if not seen and not heard.odometry and not any(heard.scans.values()):
        raise CohelmError(mismatch.nobody(transport.name, transport.unseen))
    way = way or Connection()
    why = f", because {way.why}" if way.why else ""
    notes, wrong = (
        [f"transport: {transport.name}{why}"],
        _unheard(heard, [one.name for one in model.lidars], seen),
    )
    notes += [f"{one.model.said}: {one.topic}, {one.kind}" for one in heard.contacts]
    out_type = TWIST
    if drives:
        out_type, amiss = mismatch.base_type(topics.out, allowed.stamped, COMMAND, seen)
        wrong += [amiss, "" if allowed.bypass else mismatch.bypass(topics.out, seen)]
        notes.append(f"commands to the base: {topics.out}, {out_type}")
    told: list[tuple[str, str]] = []
    if topics.footprint:
        told.append(mismatch.footprint(topics.footprint, seen))
    if topics.lock:
        told.append(mismatch.lock(topics.lock, seen, {one.topic for one in heard.contacts}))
    notes += [said for said, _ in told]
    wrong += [amiss for _, amiss in told]
    twice, shared = _shared(heard, seen)
    wrong += shared or [mismatch.frames(topic, heard.frames(topic), seen) for topic in heard.scans]
    notes += [*twice, mismatch.commands(topics.command, topics.out, heard.command_period(), seen)]
    if any(wrong):
        raise CohelmError("\n".join(filter(None, wrong)))
    made = _sensed(heard, model, allowed, out_type, notes)
    return made._replace(connection=way, endpoints=tuple(seen))


def _shared(heard: Inspection, seen: list[Endpoint]) -> tuple[list[str], list[str]]:
    """What is to be told, and what is wrong, of topics that more than one publishes."""
    found = [mismatch.alone(heard.topics.odom, ODOMETRY, "odometry", seen)]
    found += [mismatch.alone(one, heard.kinds[one], "LiDAR", seen) for one in heard.scans]
    return [told for told, _ in found if told], [amiss for _, amiss in found if amiss]


def _unheard(heard: Inspection, names: list[str], seen: list[Endpoint]) -> list[str]:
    """What did not come, a sentence each. names: of the LiDARs."""
    wrong: list[str] = []
    for topic, kind, came, option in (
        (heard.topics.odom, ODOMETRY, heard.odometry, "--odom"),
        *(
            (topic, heard.kinds[topic], rows, f"--further-scan {name}=TOPIC" if i else "--scan")
            for i, (name, (topic, rows)) in enumerate(zip(names, heard.scans.items(), strict=True))
        ),
    ):
        if len(came) < 3:
            damage = heard.damage.get(topic, "")
            wrong.append(mismatch.unheard(topic, kind, SENSOR, option, seen, damage))
    wrong += [
        mismatch.no_camera_info(topic, depth.info_topic(topic), seen)
        for topic, rows in heard.infos.items()
        if not rows and any(one.publishes and one.topic == topic for one in seen)
    ]  # fmt: skip
    silent = {o.topic: o for o in heard.contacts if o.topic not in heard.touched}
    for topic, one in sorted(silent.items()):
        damage, option = heard.damage.get(topic, ""), f"--contact {one.model.name}=TOPIC"
        wrong.append(mismatch.unheard(topic, one.kind, SENSOR, option, seen, damage))
    return wrong


def _sensed(
    heard: Inspection, model: RobotModel, allowed: Allowed, out_type: str, notes: list[str]
) -> Found:  # fmt: skip
    """What the sensors are, and when their stamps are of."""
    topics = heard.topics
    heard.settle_time()
    if heard.simulated:
        notes.append(f"simulated time: {clock.TOPIC}, {heard.clock.rate:.2f} of the wall's")
    odom_clock = estimated(heard.ages(heard.odometry), topics.odom, allowed.clock)
    odom_rate = heard.rate(heard.odometry)
    notes.append(f"odometry: {topics.odom}, {odom_rate:.0f} Hz, {heard.odom()} -> {heard.body()}")
    described = (model.lidar, *model.further_lidars)
    lidars = [
        describe(heard, topic, given, allowed)
        for topic, given in zip(heard.scans, described, strict=True)
    ]
    notes += [one.note for one in lidars]
    clocks = [(topics.odom, odom_clock), *((one.found.topic, one.found.clock) for one in lidars)]
    notes += [_differs(name, one) for name, one in clocks if one.ahead]
    notes += [
        f"{one.found.topic} is stamped at the end of each scan, and taken so"
        for one in lidars if one.found.stamped_at_end
    ]  # fmt: skip
    first, *further = (one.model for one in lidars)
    made = model.model_copy(
        update={
            "lidar": first,
            "further_lidars": tuple(further),
            "odometry": model.odometry.model_copy(update={"rate_hz": odom_rate}),
        }
    )
    return Found(
        topics, made, out_type, heard.body(), heard.odom(), odom_clock,
        tuple(one.found for one in lidars), heard.command_period(), tuple(notes),
        bypass=allowed.bypass,
        lock_silence=allowed.lock_silence, simulated=heard.simulated,
    )  # fmt: skip


def _differs(topic: str, one: Clock) -> str:
    direction = "ahead of" if one.ahead > 0.0 else "behind"
    return (
        f"the clock that stamps {topic} is {abs(one.ahead):.3f} s {direction} this machine's: "
        "taken into account, up to the time a message is under way"
    )
