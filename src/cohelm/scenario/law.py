"""The control law of a scenario: the paper's gains, and the parameters of guard and planning."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from cohelm.core.schema import Schema, refuse, renamed
from cohelm.core.types import Floats
from cohelm.law.gains import Gains
from cohelm.law.govern import PaceParams, attainable
from cohelm.law.guard.rules import Rules
from cohelm.pilot.replanning import ReplanParams
from cohelm.pilot.step import Settings
from cohelm.plan.evasion.params import HURRY, EvasionParams, adapted
from cohelm.plan.path_planner import PathParams
from cohelm.robot.limits import Limits

Gain = Annotated[float, Field(ge=0.0, le=1e4)]
PositiveGain = Annotated[float, Field(gt=0.0, le=1e4)]
Length = Annotated[float, Field(gt=0.0, le=1e3)]
AtLeast0 = Annotated[float, Field(ge=0.0, le=1e3)]
Acceleration = Annotated[float, Field(gt=0.0, le=1e3)]
Rate = Annotated[float, Field(gt=0.0, le=1e3)]
Angle = Annotated[float, Field(gt=0.0, le=1.5707)]

_PAPER, _RULES, _PACE = Gains(), Rules(), PaceParams()
_REPLAN_PARAMS, _PATH_PARAMS, _EVASION = ReplanParams(), PathParams(), EvasionParams()


class Tracking(Schema):
    """Gains of the tracking law (16)(17)."""

    k_x: PositiveGain = _PAPER.k_x
    """Surge gain [1/s]."""
    k_psi: PositiveGain = _PAPER.k_psi
    """Heading gain [1/s]."""


class Barrier(Schema):
    """The relaxed control barrier function (22)-(33)."""

    K: Gain = _PAPER.K
    """Growth rate that is tolerated (32) [1/s]."""
    C: Gain = _PAPER.C
    """Constant growth that is tolerated (32) [1/(m^2 s)]."""
    k_cbf: Gain = _PAPER.k_cbf
    """Steering to the right while the filter acts (33) [rad/s]; the paper gives no value (E3)."""
    motion_sign: Literal["derivative", "printed"] = "derivative"
    """Sign of the moving-obstacle term (27): the derivative's own, or the printed one (E2)."""


class Sharing(Schema):
    """How the operator's command and the controller's are blended (34)-(48)."""

    blend: Literal["joint", "per-axis"] = "joint"
    """One authority for both axes (47)(48), or one per axis (43)(44), found unstable (Remark 2)."""
    k_hx: Gain = _PAPER.k_hx
    """Human surge gain (45)."""
    k_hpsi: Gain = _PAPER.k_hpsi
    """Human yaw-rate gain (46) [rad/s]."""
    k_s: Gain = _PAPER.k_s
    """Spring constant of the stick (35)."""
    dead_band: Annotated[float, Field(ge=0.0, lt=1.0)] = _PAPER.dead_band
    """C_Joy (45)(46): deflections up to this count as none; the paper gives no value (E3)."""


class Guard(Schema):
    """Parameters of the guard; see docs/guard.md."""

    model_config = renamed(
        margin_m="soft_margin_m", clear_m="hard_margin_m", caution="deceleration_fraction",
        agility_mps2="obstacle_acceleration_mps2",
    )  # fmt: skip
    soft_margin_m: Length = _RULES.soft_margin
    """Clearance of the outline that commands are shaped to keep."""
    hard_margin_m: Length = _RULES.hard_margin
    """Clearance that every certified stop keeps; half of it is promised. At most soft_margin_m."""
    deceleration_fraction: Annotated[float, Field(gt=0.0, le=1.0)] = _RULES.deceleration_fraction
    """Share of the full deceleration that shaping counts on."""
    steer_weight_m: Length = _RULES.steer_weight
    """Cost of changing the yaw rate relative to the speed: large keeps the steering and slows down,
    small the reverse."""
    obstacle_acceleration_mps2: AtLeast0 = 1.0
    """Largest acceleration that moving obstacles are taken to be capable of."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.hard_margin_m > self.soft_margin_m:
            problem = f"must not be larger than soft_margin_m, which is {self.soft_margin_m:g}"
            refuse(("hard_margin_m", problem))
        return self

    def rules(self, dt: float) -> Rules:
        """The same as numbers, for a control period dt [s]."""
        return Rules(
            dt,
            self.soft_margin_m,
            self.hard_margin_m,
            self.deceleration_fraction,
            self.steer_weight_m,
        )


class PaceModel(Schema):
    """How fast the reference goes, and when it waits; with the guard only."""

    model_config = renamed(
        tight_m="creep_clearance_m", open_m="full_speed_clearance_m", creep_mps="creep_speed_mps"
    )
    lateral_mps2: Acceleration = _PACE.lateral
    """Largest lateral acceleration in turns."""
    yaw_rate_radps: Rate = _PACE.yaw_rate
    """Largest yaw rate in turns; at most three quarters of the robot's."""
    deceleration_mps2: Acceleration = _PACE.deceleration
    """Slowing down ahead of slow places and of the end; at most three quarters of the robot's."""
    creep_clearance_m: AtLeast0 = _PACE.tight
    """Clearance up to which the reference creeps."""
    full_speed_clearance_m: Length = _PACE.open
    """Clearance from which it no longer slows; more than creep_clearance_m."""
    creep_speed_mps: Rate = _PACE.creep
    """Speed where it is tight."""
    slack_m: AtLeast0 = _PACE.slack
    """How far the robot may be behind before the reference slows."""
    lag_m: Length = _PACE.lag
    """How far behind it waits; more than slack_m."""
    turn_rad: Angle = _PACE.turn
    """Heading error at which it waits."""
    guide_m: Length = _PACE.guide
    """Distance ahead that the robot steers at to come back onto the path."""
    search_m: Length = _PACE.search
    """How far ahead the nearest point is searched while the operator leads."""
    rise_per_s: Rate = _PACE.rise
    """Fastest growth of the reference's rate, which is 0 to 1; at most three quarters of the
    robot's acceleration by the reference's speed."""
    fall_per_s: Rate = _PACE.fall
    """Fastest fall of it."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.full_speed_clearance_m <= self.creep_clearance_m:
            problem = f"must be larger than creep_clearance_m, which is {self.creep_clearance_m:g}"
            refuse(("full_speed_clearance_m", problem))
        if self.lag_m <= self.slack_m:
            refuse(("lag_m", f"must be larger than slack_m, which is {self.slack_m:g}"))
        return self

    def pace(self) -> PaceParams:
        """The same as numbers."""
        return PaceParams(
            lateral=self.lateral_mps2, yaw_rate=self.yaw_rate_radps,
            deceleration=self.deceleration_mps2, tight=self.creep_clearance_m,
            open=self.full_speed_clearance_m, creep=self.creep_speed_mps, slack=self.slack_m,
            lag=self.lag_m, turn=self.turn_rad, guide=self.guide_m, search=self.search_m,
            rise=self.rise_per_s, fall=self.fall_per_s,
        )  # fmt: skip


class PlanModel(Schema):
    """Planning around obstacles; with the guard only."""

    model_config = renamed(
        look_m="lookahead_m", accept_m="accept_clearance_m", gap_m="min_clearance_m",
        room_m="ample_clearance_m", escape_mps="recovery_speed_mps",
        escape_radps="recovery_yaw_rate_radps",
    )  # fmt: skip
    lookahead_m: Annotated[float, Field(ge=0.5, le=100.0)] = _REPLAN_PARAMS.look
    """How far ahead the reference has to be clear."""
    accept_clearance_m: Length | None = None
    """Clearance of the outline with which the reference is followed as it is; by default 3 cm more
    than the guard's soft_margin_m."""
    min_clearance_m: Length | None = None
    """Least clearance of a detour, at least the guard's soft_margin_m; by default 1 cm more."""
    ample_clearance_m: Length = _PATH_PARAMS.room
    """Clearance beyond which more is not better."""
    pass_right_m: AtLeast0 = 0.0
    """How much wider moving obstacles are taken to be on the robot's left, so that it rather passes
    them on the right, as the paper's k_cbf does; 0 for the shorter side."""
    period_s: Annotated[float, Field(gt=0.0, le=10.0)] = 0.2
    """From one plan to the next."""
    recovery_speed_mps: Rate = 0.4
    """Speed of recovery moves."""
    recovery_yaw_rate_radps: Rate = 1.0
    """Yaw rate of recovery moves."""

    def replan_params(self, margin: float) -> ReplanParams:
        """When plans are made, as numbers. margin: the guard's [m]."""
        accept = margin + 0.03 if self.accept_clearance_m is None else self.accept_clearance_m
        return _REPLAN_PARAMS._replace(
            look=self.lookahead_m, known=1.5 * self.lookahead_m, accept=accept,
            foresight=_REPLAN_PARAMS.foresight._replace(right=self.pass_right_m),
        )  # fmt: skip

    def path_params(self, margin: float) -> PathParams:
        """What makes a path good, as numbers."""
        clearance = margin + 0.01 if self.min_clearance_m is None else self.min_clearance_m
        return _PATH_PARAMS._replace(clearance=clearance, room=self.ample_clearance_m)


class EvasionModel(Schema):
    """Making way for moving obstacles; with the guard only, and never while the operator leads."""

    horizon_s: Annotated[float, Field(ge=0.0, le=10.0)] | None = None
    """Prediction horizon; 0: no evasion, the robot only waits. By default as long as the robot
    needs to turn and leave the way of a wide mover, 3 s at least and 6 s at most."""
    speed_mps: Rate | None = None
    """Largest speed of an evasion; by default 1.6 times that of the reference."""
    yaw_rate_radps: Rate = _EVASION.yaw_rate
    """Largest yaw rate of one."""
    clearance_m: AtLeast0 = _EVASION.clearance
    """Clearance to a moving obstacle below which a motion is the worse the nearer it comes."""
    social_clearance_m: AtLeast0 = _EVASION.social_clearance
    """Clearance that is kept where there is room."""

    def params(self, outline: Floats, limits: Limits, u_d: float) -> EvasionParams:
        """The same as numbers, for one robot. u_d: speed of the reference [m/s]."""
        made = _EVASION._replace(
            yaw_rate=self.yaw_rate_radps, clearance=self.clearance_m,
            speed=HURRY * u_d if self.speed_mps is None else self.speed_mps,
            social_clearance=max(self.social_clearance_m, self.clearance_m),
        )  # fmt: skip
        made = adapted(made, outline, limits)
        return made if self.horizon_s is None else made._replace(horizon=self.horizon_s)


class Law(Schema):
    """What filters the command; gains of Table II, and the choices that the paper leaves open."""

    filter: Literal["guard", "barrier", "none"] = "guard"
    """The safety filter: the guard, with a reference that waits and detours; the paper's barrier;
    or none. With the last two the reference runs on with time (E12)."""
    tracking: Tracking = Tracking()
    """Parameters of the tracking law."""
    barrier: Barrier = Barrier()
    """Parameters of the paper's barrier."""
    sharing: Sharing = Sharing()
    """How the commands of operator and controller are blended."""
    guard: Guard = Guard()
    """Parameters of the guard."""
    pace: PaceModel = PaceModel()
    """Speed along the reference, and when it waits."""
    plan: PlanModel = PlanModel()
    """Planning around obstacles."""
    evasion: EvasionModel = EvasionModel()
    """Making way for moving obstacles."""

    @model_validator(mode="after")
    def _possible(self) -> Self:
        margin = self.guard.soft_margin_m
        if self.plan.min_clearance_m is not None and self.plan.min_clearance_m < margin:
            problem = f"must not be less than guard.soft_margin_m, which is {margin:g}"
            refuse(("plan.min_clearance_m", problem))
        return self

    def replan_params(self) -> ReplanParams:
        """When plans are made."""
        return self.plan.replan_params(self.guard.soft_margin_m)

    def path_params(self) -> PathParams:
        """What makes a path good."""
        return self.plan.path_params(self.guard.soft_margin_m)

    def gains(self, u_d: float) -> Gains:
        """The same as numbers, with u_d [m/s] from the reference."""
        t, b, s = self.tracking, self.barrier, self.sharing
        return Gains(
            k_x=t.k_x, k_psi=t.k_psi, K=b.K, C=b.C, k_cbf=b.k_cbf,
            k_hx=s.k_hx, k_hpsi=s.k_hpsi, k_s=s.k_s, dead_band=s.dead_band, u_d=u_d,
            barrier=self.filter == "barrier", joint=s.blend == "joint",
            true_sign=b.motion_sign == "derivative",
        )  # fmt: skip

    def settings(self, outline: Floats, limits: Limits, u_d: float, dt: float) -> Settings:
        """All of it for the pilot of one robot, at a control period dt [s]."""
        return Settings(
            outline, limits, self.gains(u_d), self.guard.rules(dt),
            attainable(self.pace.pace(), limits, u_d), self.filter == "guard", False, 0.5,
            self.plan.recovery_speed_mps, self.plan.recovery_yaw_rate_radps,
            evasion=self.evasion.params(outline, limits, u_d)._replace(
                pass_right=self.plan.pass_right_m
            ),
        )  # fmt: skip
