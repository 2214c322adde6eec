"""Turns the command line into a session: the robot, the stick, and when to end."""

from __future__ import annotations

import math
import signal
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from cohelm.core.errors import CohelmError
from cohelm.core.interrupts import INTERRUPTS
from cohelm.core.types import StickRecording
from cohelm.drive.factory import (
    OWN_SITE,
    OwnRobot,
    RobotFactory,
    mapped,
    own_robot,
    simulated,
    site_of,
)
from cohelm.link.messages import Mode
from cohelm.link.operator import NullOperator, Scripted
from cohelm.plan.zones import Zones
from cohelm.robot.model import SHIPPED, doubts
from cohelm.scenario import build, load
from cohelm.scenario.stick import StickNone, StickOperator
from cohelm.scenario.zones import masked, read_zones
from cohelm.sim.maker import Kind
from cohelm.sim.operator_model import replayed

if TYPE_CHECKING:
    from cohelm.perceive.localize.localization_map import LocalizationMap
    from cohelm.ros.masks import FilterMask


_MASKS = 10.0
"""Longest wait for a mask on a topic [s]."""


class Ros2Config(NamedTuple):
    """How to find a ROS 2 robot."""

    topics: tuple[str, ...] = ()
    """`odom=/odom` and the like, where not the default."""
    transport: str = "auto"
    url: str = ""
    """Address of its bridge or router."""
    masks: tuple[str, ...] = ()
    """Topics of CostmapFilterInfo, whose masks are its zones."""
    frame: str = "map"
    """Frame of the map and of those masks."""
    lock_silence: float = math.inf
    """Without a message on the lock's topic for so long the base is locked [s]."""


class DriveOptions(NamedTuple):
    """The robot and its site, by the options of the command line."""

    name: str | None
    """A robot or a scenario; None: the site's robot."""
    scenario: str | None
    """Where a robot is driven; None: in `factory.SITE`, a real one in `OWN_SITE`."""
    kind: Kind
    real_time: bool
    seed: int | None
    changes: list[str]
    driver: str | None = None
    """A robot that is not simulated: package:Class, or an entry point."""
    ros2: Ros2Config | None = None
    """How to find a ROS 2 robot."""
    chart: Path | None = None
    """The map to localise on; without, it is the scenario's walls."""
    keep_out: Path | None = None
    """The mask of its keep-out zones..."""
    speed_zones: Path | None = None
    """... and of its speed zones; without either, the scenario's zones."""


def robot_factory(options: DriveOptions) -> RobotFactory:
    """The robot of these options: of a scenario, or a robot's file in another scenario."""
    model, site, changes = options.name, options.scenario, list(options.changes)
    if model is not None and not load.is_robot_file(Path(model)) and model not in SHIPPED:
        load.find(model, SHIPPED)
        if site not in (None, model):
            raise CohelmError(
                f"--scenario is where a robot is driven, and {model} is none: give {site} in its "
                "place, or name a robot"
            )
        model, site = None, model
    if model is not None and any(one.partition("=")[0].strip() == "robot" for one in changes):
        raise CohelmError(f"{model} and --set robot=... each name a robot: leave one of them out")
    if options.driver is not None and options.ros2 is not None:
        raise CohelmError("--driver and --ros2 each name a robot: leave one of them out")
    if options.driver is not None or options.ros2 is not None:
        if not options.real_time or options.kind == "twin" or options.seed is not None:
            option = "--ros2" if options.driver is None else "--driver"
            raise CohelmError(
                f"with {option} nothing is simulated: leave out --twin, --fast and --seed"
            )
        if options.driver is not None:
            own = own_robot(options.driver, site, model, changes)
        else:
            own = _on_ros2(options.ros2 or Ros2Config(), site, model, changes)
        return own if options.chart is None else own.on(options.chart)
    if model is not None:
        changes.append(f"robot={model if model in SHIPPED else Path(model).absolute()}")
    return simulated(
        site, options.kind, real_time=options.real_time, seed=options.seed, changes=changes
    )


def remarks(made: RobotFactory) -> str:
    """What to say of a robot at its start: that it is guarded though the site's law has another
    filter, and what no real robot has; empty: nothing."""
    asked, said = made.scenario.law.filter, list[str]()
    if asked != "guard":
        said.append(f"guarded all the same, though law.filter is {asked}")
    if made.kind == "own":  # of a ROS 2 robot it is said where it is looked for
        said += doubts(made.model)
    return "; ".join(said)


def map_and_zones(
    options: DriveOptions, made: RobotFactory, masks: Sequence[FilterMask] = ()
) -> tuple[LocalizationMap | None, Zones]:
    """The selected map and zones. Raises CohelmError if a file or mask can not be used, or if both
    define zones of one kind."""
    chart = None if options.chart is None else mapped(options.chart, made.start)
    files = read_zones(options.keep_out, options.speed_zones, made.start)
    mask_zones = masked(masks)
    for option, one, other in zip(("--keep-out", "--speed-zones"), files, mask_zones, strict=True):
        if one is not None and other is not None:
            raise CohelmError(
                f"{option} and --masks-from define the same zones: leave one of them out"
            )
    return chart, files.over(mask_zones)


def masks_on_topics(options: DriveOptions, made: RobotFactory) -> tuple[FilterMask, ...]:
    """The selected masks of a ROS 2 robot. Raises CohelmError for one that is missing or can not be
    used."""
    from cohelm.ros.masks import Masks
    from cohelm.ros.robot import Ros2Make

    where, make = options.ros2, made.make if isinstance(made, OwnRobot) else None
    if where is None or not where.masks or not isinstance(make, Ros2Make):
        return ()
    found = make.found
    transport = found.connection.open("cohelm", found.topics.namespace)
    try:
        return Masks(transport, where.masks, where.frame, found.topics.namespace).read(_MASKS)
    finally:
        transport.close()


def _on_ros2(
    where: Ros2Config, site: str | None, model: str | None, changes: list[str]
) -> OwnRobot:
    """A ROS 2 robot, as it is found; raises CohelmError with all that does not fit."""
    from cohelm.ros.camera import choose
    from cohelm.ros.connection import connection
    from cohelm.ros.found import Allowed
    from cohelm.ros.look import look
    from cohelm.ros.option_names import ROBOT
    from cohelm.ros.robot import Ros2Make, topics_of

    named = topics_of(where.topics)
    described = site_of(site, OWN_SITE, changes).robot if model is None else load.load_robot(model)
    if isinstance(described, str):
        raise TypeError("the robot is still a name")
    way = connection(where.transport, where.url)
    transport = way.open("cohelm", named.namespace)
    try:
        allowed = Allowed(lock_silence=where.lock_silence, options=ROBOT)
        found = look(transport, described, named, allowed, way=way)
        camera, note = choose(named.camera, transport.endpoints())
        kept = (one for one in found.notes if not one.startswith("commands: "))  # of controllers
        found = found._replace(camera=camera, notes=tuple(filter(None, (*kept, note))))
    finally:
        transport.close()
    return own_robot(Ros2Make(found), site, found.model, changes)


class ScenarioStick(Scripted):
    """The scenario's stick, played in the robot's time; or none."""

    def __init__(self, table: StickRecording | None) -> None:
        self._watch: Callable[[], float] = lambda: 0.0
        super().__init__(
            lambda t: None if table is None else replayed(table, t), lambda: self._watch()
        )
        self._present = table is not None

    def watches(self, clock: Callable[[], float]) -> None:
        """Start the script now."""
        begun = clock()
        self._watch = lambda: clock() - begun

    def receive(self) -> Any:
        """The stick as it is then; absent without one."""
        return super().receive() if self._present else NullOperator().receive()


def mode_and_stick(
    made: RobotFactory, mode: str, joystick: bool = False, goals: bool = False
) -> tuple[Mode, ScenarioStick]:
    """The mode to drive in, and the scenario's stick. Raises CohelmError for an unknown mode.

    mode: the user's choice; empty: shared with a stick, else automatic. But a real robot whose site
    is not named has no route: it holds, or is steered by the joystick alone. joystick: whether
    one on a topic steers. goals: whether it waits for goals instead of following the site's route.
    Raises CohelmError for automatic mode without either.
    """
    present = not isinstance(made.scenario.stick, (StickNone, StickOperator))
    stick = ScenarioStick(build.setup(made.scenario).recorded_stick if present else None)
    lead = goals or made.route is not None
    if not mode and not lead:
        return (Mode.MANUAL if joystick else Mode.HOLD), stick
    if not mode:
        return (Mode.SHARED if present or joystick else Mode.AUTOMATIC), stick
    try:
        chosen = Mode[mode.upper()]
    except KeyError as error:
        names = ", ".join(m.name.lower() for m in Mode)
        raise CohelmError(f"--mode: there is no mode {mode!r}; there are {names}") from error
    if chosen == Mode.AUTOMATIC and not lead:
        raise CohelmError("automatic mode follows a route, and there is none: name a site")
    return chosen, stick


_SIGNALS = {
    signal.SIGINT: "Ctrl-C", signal.SIGTERM: "received SIGTERM",
    signal.SIGHUP: "the terminal was closed",
}  # fmt: skip


class End:
    """Whether the drive is to end, and why."""

    def __init__(self, signals: list[signal.Signals]) -> None:
        self.reason = ""
        self._signals = signals
        self._until = math.inf

    def handle_signals(self, seconds: float | None = None) -> None:
        """Signals become requests: the robot may move, and must be stopped first. seconds: end
        after so many."""
        for number in self._signals:
            signal.signal(number, self._request)
        if seconds is not None:
            self._until = time.monotonic() + seconds

    def over(self) -> str:
        """Why the drive is to end now; empty: it continues."""
        return self.reason or ("its time is over" if time.monotonic() >= self._until else "")

    def _request(self, number: int, _: object) -> None:
        self.reason = _SIGNALS[signal.Signals(number)]


@contextmanager
def end_signals() -> Generator[End]:
    """Handle `INTERRUPTS`: while a robot starts they end this process at once, even in the
    middle of compiling; once it may move, they request the end, see `End.handle_signals`.

    Under `nohup`, which ignores the end of the terminal, the drive continues without one.
    """
    signals: list[signal.Signals] = list(INTERRUPTS)
    if signal.getsignal(signal.SIGHUP) == signal.SIG_IGN:
        signals.remove(signal.SIGHUP)
    before = {number: signal.signal(number, signal.SIG_DFL) for number in signals}
    signal.pthread_sigmask(signal.SIG_UNBLOCK, signals)  # see `robot.keep.processes`
    try:
        yield End(signals)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
