"""The topics in use: the user's names, or the usual ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from cohelm.core.errors import CohelmError
from cohelm.robot.model import RobotModel
from cohelm.ros.contact import usual_topic
from cohelm.ros.names import namespace_of, resolved


class Topics(NamedTuple):
    """Where what is, by full name."""

    command: str = "/cmd_vel_nav"
    out: str = "/cmd_vel"
    scan: str = "/scan"
    odom: str = "/odom"
    lock: str = "/emergency_stop"
    """Empty: none."""
    namespace: str = "/"
    further: tuple[tuple[str, str], ...] = ()
    """Of further LiDARs: name and topic. Of one that is not named here: /scan_NAME."""
    contacts: tuple[tuple[str, str], ...] = ()
    """The same of bumpers and cliff sensors: /bumper_NAME, /cliff_NAME, /hazard_detection."""
    footprint: str = ""
    """Of the robot's outline, where that changes; empty: none."""
    camera: str | None = None
    """Of pictures; empty: none; None: the only one there is."""

    @classmethod
    def named(
        cls, namespace: str = "/", command: str = "/cmd_vel_nav", out: str = "/cmd_vel",
        scan: str = "/scan", odom: str = "/odom", lock: str = "/emergency_stop",
        further: Sequence[str] = (), contacts: Sequence[str] = (), camera: str | None = None,
        footprint: str = "",
    ) -> Topics:  # fmt: skip
        """The user's names: in a namespace, if there is one, also the defaults with a leading
        slash. further: `NAME=TOPIC` for each further LiDAR whose topic is not /scan_NAME; contacts:
        the same of bumpers and cliff sensors. CohelmError for an invalid name."""
        space = namespace_of(namespace)
        inside = [
            name and resolved(name.lstrip("/") if name == default else name, space)
            for name, default in zip(
                (command, out, scan, odom, lock), cls._field_defaults.values(), strict=False
            )
        ]
        camera = resolved(camera, space) if camera else camera
        return cls(
            *inside, namespace=space, further=_pairs(further, "a further LiDAR's scans", space),
            contacts=_pairs(contacts, "a bumper or cliff sensor", space), camera=camera,
            footprint=resolved(footprint, space) if footprint else "",
        )  # fmt: skip

    def of_lidars(self, model: RobotModel) -> tuple[str, ...]:
        """The topics of its LiDARs' scans, the first one first. CohelmError for a topic of a LiDAR
        that the robot does not have."""
        usual = {one.name: f"scan_{one.name}" for one in model.further_lidars}
        why = f"{model.name} has no further LiDAR", "further_lidars"
        topics = (self.scan, *self._named(self.further, usual, *why))
        if shared := [one for i, one in enumerate(topics) if one in topics[:i]]:
            raise CohelmError(
                f"two LiDARs of {model.name} can not share a topic, and both are on {shared[0]}: "
                "name one for each"
            )
        return topics

    def by_use(self, model: RobotModel) -> dict[str, str]:
        """All that a robot has, by the keys of `--topic`."""
        lidars = ("scan", *(f"scan_{one.name}" for one in model.further_lidars))
        contacts = (f"contact_{one.name}" for one in model.contacts)
        named = {
            "command": self.command, "out": self.out, "odom": self.odom,
            **dict(zip(lidars, self.of_lidars(model), strict=True)),
            **dict(zip(contacts, self.of_contacts(model), strict=True)),
            "lock": self.lock, "footprint": self.footprint,
        }  # fmt: skip
        return {key: topic for key, topic in named.items() if topic}

    def of_contacts(self, model: RobotModel) -> tuple[str, ...]:
        """The topics of its bumpers and cliff sensors. CohelmError for one that the robot does not
        have."""
        usual = {one.name: usual_topic(one) for one in model.contacts}
        why = f"{model.name} has no bumper or cliff sensor", "bumpers or cliff_sensors"
        return tuple(self._named(self.contacts, usual, *why))

    def _named(
        self, named: tuple[tuple[str, str], ...], usual: dict[str, str], none: str, where: str
    ) -> list[str]:
        """The topics of sensors by their names: the user's, or the usual ones. none, where: that
        there is none of that name, and where the robot's file has them."""
        if strange := [name for name, _ in named if name not in usual]:
            raise CohelmError(
                f"{none} {strange[0]!r}: describe it under {where} in the robot's YAML file"
            )
        topics = {name: resolved(topic, self.namespace) for name, topic in usual.items()}
        return list((topics | dict(named)).values())


def _pairs(named: Sequence[str], what: str, space: str) -> tuple[tuple[str, str], ...]:
    """Names and topics. CohelmError for what is no `NAME=TOPIC`."""
    pairs = [one.partition("=") for one in named]
    if bad := [one for one, (_, _, topic) in zip(named, pairs, strict=True) if not topic]:
        raise CohelmError(f"{bad[0]!r}: name {what} as NAME=TOPIC")
    return tuple((name, resolved(topic, space)) for name, _, topic in pairs)
