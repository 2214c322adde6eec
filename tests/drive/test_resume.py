"""Nothing resumes by itself: no motion without a mode chosen since the last stop, hold, release or
fault, by somebody who drives."""

import os
import random

import pytest

from cohelm.core.types import Stick
from cohelm.drive import rerouting
from cohelm.drive.session import Session, SessionConfig
from cohelm.link.messages import Arming, Mode, RequestKind
from cohelm.link.operator import Scripted
from cohelm.loop.loop import LoopParams
from cohelm.robot.gate.modes import GateMode
from tests.drive.faults import failing
from tests.drive.resuming import Drive
from tests.drive.simulated_link import CENTRED
from tests.few import first

DOCKS = ", ".join(
    f"{{name: {x:.0f} {y:.1f}, x_m: {x}, y_m: {y}, heading_rad: {psi}, approach_m: 5, "
    "margin_m: 0.08, within_s: 1}"
    for y in (-0.8, -0.4, 0.0, 0.4, 0.8) for x, psi in ((5.0, 0.0), (1.0, 3.14159))
)  # fmt: skip
"""Side by side along the corridor, either way: the robot is often at one, and soon over."""
SOON = 2.0
"""A path that takes for ever is given up after so long here [s]."""
AWAY, BACK = [(4.0, 0.3), (6.0, 0.0)], [(2.5, 0.0), (0.5, 0.2)]


@pytest.fixture
def drive(tmp_path):
    with Drive(tmp_path) as made:
        yield made


def speed(drive: Drive) -> float:
    return abs(drive.gated.truth().twist.v)


def waits(periods: int):
    yield from range(periods)


def driving(drive: Drive, mode: Mode = Mode.AUTOMATIC):
    """Somebody has taken the robot and it drives."""
    anna = drive.station("anna")
    yield from waits(10)
    anna.ask(RequestKind.TAKE)
    yield from waits(10)
    anna.ask(RequestKind.MODE, mode)
    yield from waits(60)
    assert drive.rule.mode == mode, list(anna.answers.values())
    assert speed(drive) > 0.3
    return anna


def test_a_new_path_is_adopted_in_the_present_mode_and_no_mode_is_stored(drive):
    def script():
        anna = yield from driving(drive)
        anna.propose(BACK)
        yield from waits(10)
        assert drive.loop.supervisor.paused
        assert drive.loop.supervisor.mode == Mode.AUTOMATIC
        yield from waits(40)
        assert drive.loop.driver is not drive.first
        assert not drive.loop.supervisor.paused
        yield from waits(40)
        assert speed(drive) > 0.1
        assert [(c.answer.granted, c.answer.reason) for c in anna.bulk.replies] == [(True, "")]

    drive.first = drive.loop.driver
    drive.run(script())


@pytest.mark.parametrize(
    "ends", first(["hold", "stop and reset", "fault", "gone", "stop", "release"], 4)
)
@pytest.mark.parametrize("after", first([3, 0, 15]))
def test_a_mode_that_ends_while_a_path_is_planned_stays_ended(drive, ends, after):
    drive.beside.paths.takes = 20

    def script():
        anna = yield from driving(drive)
        bert = drive.station("bert")
        anna.propose(BACK)
        yield from waits(5 + after)
        if ends == "hold":
            anna.ask(RequestKind.MODE, Mode.HOLD)
        elif ends == "release":
            anna.ask(RequestKind.GIVE)
        elif ends == "gone":
            anna.leave()
        elif ends == "fault":
            drive.wheels.bumped = True
        else:
            bert.ask(RequestKind.STOP)
        yield from waits(40)
        drive.wheels.bumped = False
        if ends == "stop and reset":
            anna.ask(RequestKind.RESET)
        yield from waits(120)
        assert drive.rule.mode == Mode.HOLD
        assert drive.loop.supervisor.mode == Mode.HOLD
        assert not drive.loop.supervisor.paused
        assert speed(drive) == 0.0
        if ends == "stop and reset":
            assert drive.gated.gate.mode == GateMode.IDLE
            anna.ask(RequestKind.MODE, Mode.AUTOMATIC)
            yield from waits(60)
            assert speed(drive) > 0.1

    drive.run(script())


@pytest.mark.parametrize("fails", first(["check", "takes for ever", "mistake", "build"], 2))
def test_a_path_that_can_not_be_planned_ends_in_hold_with_an_alarm(drive, monkeypatch, fails):
    monkeypatch.setattr(rerouting, "WITHIN", SOON)

    def script():
        anna = yield from driving(drive)
        drive.beside.paths.takes = 10**9 if fails == "takes for ever" else 5
        anna.propose(BACK)
        yield from waits(6)
        assert drive.loop.supervisor.paused
        drive.beside.fails = fails
        yield from waits(round(50 * (SOON + 0.5)) if fails == "takes for ever" else 80)
        assert drive.loop.supervisor.mode == Mode.HOLD
        assert not drive.loop.supervisor.paused
        assert any("no new path, the robot holds" in a.text for a in drive.loop.alarms.worst())
        drive.beside.fails, drive.beside.paths.takes = "", 0  # and the next one is made
        if fails == "takes for ever":
            drive.beside.paths._due[0][0] = 0
        anna.ask(RequestKind.MODE, Mode.AUTOMATIC)
        yield from waits(40)
        assert speed(drive) > 0.1
        anna.propose(BACK)
        yield from waits(60)
        assert drive.loop.supervisor.mode == Mode.AUTOMATIC
        assert drive.loop.driver is not drive.first
        yield from waits(20)
        assert speed(drive) > 0.1

    drive.first = drive.loop.driver
    drive.run(script())


def test_no_path_is_planned_for_a_former_driver(drive):
    drive.beside.paths.takes = 20

    def script():
        anna = yield from driving(drive)
        bert = drive.station("bert")
        yield from waits(5)
        anna.propose(BACK)
        yield from waits(8)
        anna.ask(RequestKind.GIVE, bert.number)
        yield from waits(10)
        bert.ask(RequestKind.MODE, Mode.AUTOMATIC)
        yield from waits(60)
        assert drive.loop.driver is drive.first
        assert speed(drive) > 0.3  # on the way that bert saw when he chose

    drive.first = drive.loop.driver
    drive.run(script())


@pytest.mark.parametrize("mode", first([Mode.SHARED, Mode.AUTOMATIC, Mode.MANUAL]))
def test_no_mode_outlives_the_lease_in_which_it_was_chosen(drive, mode):
    def script():
        anna = drive.station("anna")
        yield from waits(5)
        anna.ask(RequestKind.TAKE)
        yield from waits(5)
        anna.ask(RequestKind.MODE, mode)
        yield from waits(10)
        anna.stick = Stick(0.8, 0.0)
        yield from waits(60)
        assert speed(drive) > 0.1
        bert = drive.station("bert")
        yield from waits(5)
        anna.ask(RequestKind.GIVE, bert.number)
        yield from waits(60)
        assert drive.rule.driver == bert.number
        assert drive.loop.supervisor.mode == Mode.HOLD
        assert speed(drive) == 0.0

    drive.run(script())


@pytest.mark.parametrize("mode", [Mode.MANUAL, Mode.SHARED])
@pytest.mark.parametrize("before", first([Mode.AUTOMATIC, Mode.HOLD]))
def test_a_mode_does_not_begin_to_steer_by_a_stick_that_was_left_deflected(drive, before, mode):
    """A pad that lies on its side, of which nobody thinks when a mode is chosen."""

    def script():
        anna = drive.station("anna")
        yield from waits(10)
        anna.ask(RequestKind.TAKE)
        yield from waits(10)
        assert drive.loop.supervisor.stick_state.arming == Arming.ARMED
        anna.ask(RequestKind.MODE, before)
        anna.stick = Stick(0.0, 1.0)
        yield from waits(30)
        anna.ask(RequestKind.MODE, mode)
        for _ in range(60):
            yield
            if drive.loop.supervisor.mode == mode:
                assert drive.loop.supervisor.stick_state.stick == CENTRED
        assert drive.loop.supervisor.mode == mode
        assert drive.loop.supervisor.stick_state.arming == Arming.WAITING
        anna.stick = CENTRED
        yield from waits(5)
        anna.stick = Stick(0.0, 1.0)
        yield from waits(30)
        assert drive.loop.supervisor.stick_state.stick == Stick(0.0, 1.0)
        other = Mode.SHARED if mode == Mode.MANUAL else Mode.MANUAL
        anna.ask(RequestKind.MODE, other)  # whoever steers already goes on
        yield from waits(10)
        assert drive.loop.supervisor.mode == other
        assert drive.loop.supervisor.stick_state.stick == Stick(0.0, 1.0)

    drive.run(script())


@pytest.mark.parametrize("ends", ["release", "lost"])
def test_carry_on_applies_to_a_lost_driver_and_not_to_a_released_lease(tmp_path, ends):
    def script(drive: Drive):
        anna = yield from driving(drive)
        if ends == "release":
            anna.ask(RequestKind.GIVE)
        else:
            anna.leave()
            drive.rule = Lenient(drive.rule)
        yield from waits(60)
        assert drive.link.end.driver == 0
        assert (speed(drive) > 0.3) is (ends == "lost")
        bert = drive.station("bert")
        yield from waits(5)
        bert.ask(RequestKind.TAKE)  # and with another driver it is over
        yield from waits(60)
        assert drive.loop.supervisor.mode == Mode.HOLD
        assert speed(drive) == 0.0

    with Drive(tmp_path, LoopParams(carry_on=True)) as made:
        made.run(script(made))


class Lenient:
    """Nothing is held against a robot that may go on alone."""

    def __init__(self, rule) -> None:
        self.follow = self.holds = lambda *_: None


def test_a_mode_requested_before_another_operators_stop_is_refused(drive):
    """The network is out for 0.4 s; meanwhile anna asks, and then bert stops once more."""

    def script():
        anna = yield from driving(drive)
        bert = drive.station("bert")
        yield from waits(5)
        bert.ask(RequestKind.STOP)
        yield from waits(60)
        anna.silent = True
        anna.ask(RequestKind.RESET)
        anna.ask(RequestKind.MODE, Mode.AUTOMATIC)
        yield from waits(4)
        bert.ask(RequestKind.STOP)
        yield from waits(16)
        anna.silent = False
        yield from waits(60)
        assert drive.gated.gate.mode == GateMode.STOPPED
        late = [answer for answer in anna.answers.values() if not answer[0]]
        assert late[0][1] == "the robot was stopped after your request: request it again"
        anna.ask(RequestKind.RESET)
        anna.ask(RequestKind.MODE, Mode.AUTOMATIC)
        yield from waits(60)
        assert speed(drive) > 0.3

    drive.run(script())


def test_a_stop_together_with_the_drivers_requests_is_executed(drive):
    """Two stops reach the loop in one period; what was asked before both were obeyed is not done,
    even by one of the two."""

    def script():
        anna = yield from driving(drive)
        bert = drive.station("bert")
        yield from waits(5)
        anna.ask(RequestKind.STOP)
        bert.ask(RequestKind.STOP)
        yield from waits(1)
        anna.ask(RequestKind.RESET)
        mode = anna.ask(RequestKind.MODE, Mode.AUTOMATIC)
        yield from waits(60)
        assert bert.answers[1] == (True, "")
        assert anna.answers[mode] == (
            False, "the robot was stopped after your request: request it again",
        )  # fmt: skip
        assert drive.gated.gate.mode == GateMode.STOPPED

    drive.run(script())


def test_a_mode_request_followed_by_a_release_is_refused(drive):
    def script():
        anna = drive.station("anna")
        yield from waits(10)
        anna.ask(RequestKind.TAKE)
        yield from waits(10)
        anna.ask(RequestKind.MODE, Mode.AUTOMATIC)
        anna.ask(RequestKind.GIVE)
        anna.ask(RequestKind.TAKE)
        yield from waits(60)
        assert anna.answers[2] == (False, "you are no longer the driver")
        assert drive.rule.driver == anna.number
        assert drive.loop.supervisor.mode == Mode.HOLD
        assert drive.moved == 0

    drive.run(script())


def test_stop_and_mode_in_one_datagram_end_in_a_stop(drive):
    def script():
        anna = yield from driving(drive)
        anna.ask(RequestKind.STOP)
        anna.ask(RequestKind.MODE, Mode.MANUAL)
        yield from waits(5)
        assert drive.gated.gate.mode == GateMode.STOPPED
        anna.ask(RequestKind.MODE, Mode.MANUAL)
        anna.ask(RequestKind.STOP)
        yield from waits(60)
        assert drive.gated.gate.mode == GateMode.STOPPED
        assert speed(drive) == 0.0

    drive.run(script())


def test_the_last_stop_wins_in_whatever_order_requests_arrive():
    """The link hands stops over before all else."""
    operator = Scripted(lambda _: CENTRED, lambda: 0.0)
    with Session(SessionConfig(failing("", 1e9)), operator) as session:
        session.gated.stop("for a start")
        operator.ask(RequestKind.RESET)
        operator.ask(RequestKind.MODE, Mode.AUTOMATIC)
        operator.ask(RequestKind.STOP)
        operator._requests.reverse()
        periods = iter(range(10))
        session.run(lambda _: next(periods, None) is None)
        assert session.gated.gate.mode == GateMode.STOPPED
        assert session.loop.supervisor.mode == Mode.HOLD


def test_too_many_requests_at_once_are_refused_except_stops():
    operator = Scripted(lambda _: CENTRED, lambda: 0.0)
    with Session(SessionConfig(failing("", 1e9)), operator) as session:
        for _ in range(100):
            operator.ask(RequestKind.MODE, Mode.AUTOMATIC)
        operator.ask(RequestKind.STOP)
        session.run(lambda _: True)
        assert session.gated.gate.mode == GateMode.STOPPED
        assert operator.answers[0][:2] == (101, True)  # the stop, before all that came with it
        assert sum(granted for _, granted, _ in operator.answers) == 1
        assert operator.answers[50][2] == "too many requests: wait a moment and try again"


def test_the_start_mode_is_not_resumed_after_a_stop():
    """The robot can not drive at once; somebody stops it meanwhile, and has it let go."""
    operator = Scripted(lambda _: CENTRED, lambda: 0.0)
    with Session(SessionConfig(failing("", 0.0)), operator) as session:
        loop, end = session.loop, session.loop.gated.now()
        robot = session.gated._robot
        robot._fault = "odometry is gone"
        asked = {1.0: RequestKind.STOP, 2.0: RequestKind.RESET}

        def until(_) -> bool:
            now = loop.gated.now() - end
            for at in [at for at in asked if now >= at]:
                operator.ask(asked.pop(at))
            if now > 1.2:
                robot._fault = ""  # now it could
            return now > 6.0

        session.run(until, Mode.AUTOMATIC)
        assert [answer[1] for answer in operator.answers] == [True, True]
        assert session.gated.gate.mode == GateMode.IDLE
        assert loop.supervisor.mode == Mode.HOLD
        assert session.gated.truth().pose.x == pytest.approx(0.0, abs=1e-3)


# ---- any sequence ---------------------------------------------------------------------------


def anything(drive: Drive, rng: random.Random, steps: int, history: list[str]):
    """Requests of up to three people, their sticks, deaths and failures, at random times."""
    people = [drive.station(f"p{i}", delay=0.02 + 0.1 * i) for i in range(2)]
    modes = [Mode.AUTOMATIC, Mode.AUTOMATIC, Mode.SHARED, Mode.MANUAL, Mode.HOLD]

    def own():
        """Whoever drives, more often than not: else most is refused."""
        station = drive.link.stations.get(drive.rule.driver)
        return station if station in people and rng.random() < 0.8 else rng.choice(people)

    def does(what: str) -> str:
        loop, beside, wheels = drive.loop, drive.beside, drive.wheels
        match what:
            case "mode":
                who, mode = own(), rng.choice(modes)
                who.ask(RequestKind.MODE, mode)
                return f"{who.name} {mode.name}"
            case "go":  # what a person does who wants to drive
                who = own()
                for ask, value in (
                    (RequestKind.TAKE, 0),
                    (RequestKind.RESET, 0),
                    (RequestKind.MODE, rng.choice(modes)),
                ):
                    who.ask(ask, value)
                return who.name
            case "dock" | "undock":
                who, number = own(), rng.choice([0, 0, 0, 0, 5, 99])
                if rng.random() < 0.7:  # one who wants to
                    who.stick = CENTRED
                    who.ask(RequestKind.TAKE)
                    who.ask(RequestKind.RESET)
                who.ask(RequestKind[what.upper()], number)
                return f"{who.name} {number}"
            case "take" | "refuse" | "reset" | "acknowledge":
                who = own()
                who.ask(RequestKind[what.upper()])
                return who.name
            case "stop":
                who = rng.choice(people)
                who.ask(RequestKind.STOP)
                return who.name
            case "give":
                who, to = own(), rng.choice([0, 0, *(p.number for p in people)])
                who.ask(RequestKind.GIVE, to)
                return f"{who.name} {to}"
            case "record":
                own().ask(RequestKind.RECORD, rng.randrange(2))
            case "way":
                who = own()
                x = loop.seen.pose.x if loop.seen else 0.0
                to = 5.5 if x < 3.0 else 0.5
                far = [(x + 0.3 * (to - x), rng.uniform(-0.3, 0.3)), (to, rng.uniform(-0.3, 0.3))]
                who.propose(far if rng.random() < 0.9 else [(99.0, 0.0)], rng.random() < 0.3)
                return who.name
            case "stick":
                who = own()
                who.stick = rng.choice(
                    [CENTRED, CENTRED, Stick(0.8, 0.0), Stick(-0.5, 0.3), Stick(0.3, -0.9)]
                )
                return f"{who.name} {who.stick}"
            case "invalid":
                who = rng.choice(people)
                who.valid, who.armed = rng.random() < 0.7, rng.random() < 0.9
            case "silent":
                who = rng.choice(people)
                who.silent = not who.silent
                return who.name
            case "gone":
                i = rng.randrange(len(people))
                people[i].leave()
                people[i] = drive.station(people[i].name, rng.choice([0.0, 0.02, 0.1, 0.2]))
                return people[i].name
            case "slow":
                rng.choice(people).delay = rng.choice([0.0, 0.02, 0.05, 0.2])
            case "fails":
                beside.fails = rng.choice(["", "", "check", "mistake", "build"])
                return beside.fails
            case "takes":
                beside.checking.takes = rng.choice([0, 1, 10])
                beside.paths.takes = rng.choice([0, 1, 10, 60])
                beside.records.takes = rng.choice([0, 5, 50])
            case "bump":
                wheels.bumped = not wheels.bumped
            case "scan":
                scan = loop.readings.scan if loop.readings else None
                wheels.held = scan if wheels.held is None else None
            case "planner":
                loop.driver._planning.broken = True
        return ""

    often = {
        "mode": 12, "go": 12, "stick": 8, "dock": 4, "undock": 2, "way": 8, "stop": 3,
        "take": 3, "give": 3, "reset": 3,
        "acknowledge": 1, "refuse": 1, "record": 1, "invalid": 1, "silent": 1, "gone": 1, "slow": 1,
        "fails": 2, "takes": 2, "bump": 1, "scan": 1, "planner": 0.2, "sound": 4,
    }  # fmt: skip
    for _ in range(steps):
        what = rng.choices(list(often), list(often.values()))[0]
        if what == "sound":  # all that was broken is mended, so that something can move
            drive.wheels.bumped, drive.wheels.held, drive.beside.fails = False, None, ""
            for person in people:
                person.silent, person.valid, person.armed = False, True, True
        said = does(what)
        history.append(f"{drive.gated.now():.2f} {what} {said}")
        yield from waits(rng.choice([1, 1, 1, 1, 1, 1, 1, 1, 3, 3, 10]))


def some(folder, seed: int, steps: int) -> Drive:
    history: list[str] = []
    with Drive(folder, changes=[f"docks=[{DOCKS}]"]) as made:
        try:
            made.run(anything(made, random.Random(seed), steps, history))
        except BaseException:
            print(f"seed {seed}, the last of {len(history)} steps:", *history[-25:], sep="\n")
            raise
    return made


@pytest.mark.parametrize(("seed", "steps"), first([(5, 500), (0, 1000), (1, 1000), (2, 1000)]))
def test_no_sequence_of_requests_deaths_and_timings_sets_the_robot_off(tmp_path, seed, steps):
    made = some(tmp_path, seed, steps)
    assert made.rule.given > 20
    assert made.moved > 100  # else it shows nothing
    assert made.docked > 10


@pytest.mark.slow
def test_no_long_sequence_of_requests_and_deaths_moves_the_robot(tmp_path):
    """COHELM_STEPS of them, 100 000 by default, on seeds that the short one does not use, from
    COHELM_SEED on."""
    left, given, moved = int(os.environ.get("COHELM_STEPS", "100000")), 0, 0
    seed = int(os.environ.get("COHELM_SEED", "1000"))
    while left > 0:
        folder = tmp_path / str(seed)
        folder.mkdir()
        made = some(folder, seed, min(left, 2000))
        left, seed = left - 2000, seed + 1
        given, moved = given + made.rule.given, moved + made.moved
        print(f"seed {seed - 1}: {left} left, {given} modes, {moved} periods moving", flush=True)
    assert moved > 1000
