"""The stick of a scenario: none, a script, a file, or a simulated operator."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from cohelm.core.schema import Schema, refuse
from cohelm.sim.operator_model import OperatorModel

Deflection = Annotated[float, Field(ge=-1.0, le=1.0)]
FullScale = Annotated[float, Field(gt=0.0, le=1e6)]
Time = Annotated[float, Field(ge=-1e6, le=1e6)]
_PERSON = OperatorModel()


class StickNone(Schema):
    """The stick stays centred."""

    kind: Literal["none"] = "none"
    """The stick stays centred."""


class StickScript(Schema):
    """The stick moves as written here."""

    kind: Literal["script"]
    """The stick moves as written here."""
    events: Annotated[list[tuple[Time, Deflection, Deflection]], Field(min_length=1)]
    """[t_s, fore_aft, left_right] in the order of time: deflections in [-1, 1], forward and left
    positive, each held until the next event. After the last one the stick is centred."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        times = [event[0] for event in self.events]
        for i in range(1, len(times)):
            if times[i] < times[i - 1]:
                problem = f"comes after an event at {times[i - 1]:g} s but says {times[i]:g} s"
                refuse((f"events.{i}", f"{problem}; sort by time"))
        return self


class StickFile(Schema):
    """The stick moves as recorded in a file."""

    kind: Literal["file"]
    """The stick moves as recorded in a file."""
    path: Annotated[str, Field(min_length=1)]
    """A CSV file, plain or gzip, with columns t, x, psi (or t, fore_aft, left_right), or a log
    with columns run, t, joy_v, joy_w or run, source, t, v, w. `path#run` chooses a run."""
    run: str | None = None
    """Which run of a file that holds several; quote a number."""
    source: str | None = None
    """Which source of a log that holds several; by default the one that held the stick."""
    start_s: Annotated[float, Field(ge=-1e12, le=1e12)] = 0.0
    """Time of the run at which the file's time 0 is played."""
    full_scale: tuple[FullScale, FullScale] | None = None
    """What the file writes for full deflection [fore-aft, left-right]; by default 1 and 1, for
    the logs with joy_v, joy_w or v, w columns 1 and 1.3."""
    clip: bool = False
    """Cut deflections beyond full scale instead of refusing them."""
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")] | None = None
    """Digest of the file; when given, a file that has changed since is refused."""


class StickOperator(Schema):
    """A simulated operator that watches the way ahead, dodges what is in it, and lets go."""

    kind: Literal["operator"]
    """A simulated operator that dodges what is in the way, and lets go."""
    minds: list[str] | None = None
    """Names of the obstacles that the operator dodges; by default all."""
    look_ahead_m: Annotated[float, Field(gt=0.0, le=100.0)] = _PERSON.look_ahead
    """How far ahead of the robot's centre an obstacle's surface is noticed."""
    half_width_m: Annotated[float, Field(ge=0.0, le=100.0)] = _PERSON.half_width
    """How near the line ahead an obstacle's surface counts as in the way."""
    behind_m: Annotated[float, Field(ge=0.0, le=100.0)] = _PERSON.behind
    """How far past the robot's centre an obstacle must be to be forgotten."""
    surge: Deflection = _PERSON.surge
    """Fore-aft deflection while dodging."""
    yaw: Annotated[float, Field(ge=0.0, le=1.0)] = _PERSON.yaw
    """Largest left-right deflection while dodging."""
    steer_per_rad: Annotated[float, Field(ge=0.0, le=100.0)] = _PERSON.steer
    """Left-right deflection per radian of bearing of the place that is steered for."""
    berth_m: Annotated[float, Field(ge=0.0, le=100.0)] = _PERSON.berth
    """From an obstacle's centre to the place beside it that the operator steers for."""
    reaction_s: Annotated[float, Field(ge=0.0, le=60.0)] = _PERSON.reaction
    """From noticing to acting."""
    linger_s: Annotated[float, Field(ge=0.0, le=60.0)] = _PERSON.linger
    """From the last sight of an obstacle to letting go."""
    hold_s: Annotated[float, Field(ge=0.0, le=600.0)] = _PERSON.hold
    """Shortest time that the stick is held once taken."""
    hand_rate_per_s: Annotated[float, Field(gt=0.0, le=1000.0)] = _PERSON.hand_rate
    """Fastest movement of the stick, in full deflections per second."""
    tremor: Annotated[float, Field(ge=0.0, le=1.0)] = _PERSON.tremor
    """Standard deviation of the stick's trembling while it is held, in deflection."""

    def person(self) -> OperatorModel:
        """The same as numbers."""
        return OperatorModel(
            active=True, look_ahead=self.look_ahead_m, half_width=self.half_width_m,
            behind=self.behind_m, surge=self.surge, yaw=self.yaw, steer=self.steer_per_rad,
            berth=self.berth_m, reaction=self.reaction_s, linger=self.linger_s, hold=self.hold_s,
            hand_rate=self.hand_rate_per_s, tremor=self.tremor,
        )  # fmt: skip


Stick = Annotated[StickNone | StickScript | StickFile | StickOperator, Field(discriminator="kind")]
"""One of the four, selected by `kind`."""
