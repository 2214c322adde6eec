"""A law by somebody else in a campaign: the same episodes and judge, errors with a sentence."""

import contextlib
import ctypes
import math
import multiprocessing
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import cohelm
from cohelm.core.errors import CohelmError
from cohelm.robot.keep.child import Child
from cohelm.study.campaign import apart, report
from cohelm.study.campaign.laws import own_code
from cohelm.study.campaign.replay_episode import again, drive
from cohelm.study.campaign.result import fault_of
from cohelm.study.campaign.runner import CampaignConfig, run
from cohelm.study.campaign.suites import suite
from cohelm.study.campaign.worker import chunk
from tests.few import first

ROOMS = suite("random", 1, None)
HERE = "tests.study.campaign.test_external_law"


def ram(robot: cohelm.RobotModel, period: float):
    """At the goal, whatever is in between."""

    def law(now: cohelm.Observation) -> cohelm.Twist:
        turn = math.atan2(now.goal[1] - now.pose.y, now.goal[0] - now.pose.x) - now.pose.psi
        return cohelm.Twist(1.0, 2.0 * math.remainder(turn, 2.0 * math.pi))

    return law


def employs(robot: cohelm.RobotModel, period: float):
    """Has a process of its own, as solvers have."""
    helper = multiprocessing.get_context("spawn").Process(target=int)
    helper.start()
    helper.join()
    return ram(robot, period)


def filtered(robot: cohelm.RobotModel, period: float):
    """The same behind the filter."""
    safe, law = cohelm.SafetyFilter(robot, period), ram(robot, period)
    return lambda now: safe(now.pose, now.twist, law(now), now.obstacles).twist


number = 3


def leaves(robot: cohelm.RobotModel, period: float):
    """Ends the program, as one with a bare sys.exit does."""
    return lambda now: sys.exit(0)


def forgets(robot: cohelm.RobotModel, period: float):
    """Returns nothing, after a while."""
    return lambda now: cohelm.Twist(0.2, 0.0) if now.t < 1.0 else None


def asks_wrongly(robot: cohelm.RobotModel, period: float):
    """Has a sentence of ours raised inside."""
    return lambda now: now.obstacles.placed(None)


def hangs(robot: cohelm.RobotModel, period: float):
    """Never returns, in compiled code that does not let go of the interpreter; nor does a process
    that it has started."""
    sleep = ctypes.PyDLL(None).sleep
    subprocess.Popen(["sleep", "98765"])
    return lambda now: cohelm.Twist(0.2, 0.0) if now.t < 1.0 else sleep(100_000)


def tells(robot: cohelm.RobotModel, period: float):
    """The same at once, after it has said which process it is."""
    ready = Path(os.environ["TOLD"])
    ready.with_suffix(".new").write_text(str(os.getpid()))
    ready.with_suffix(".new").rename(ready)
    return lambda now: ctypes.PyDLL(None).sleep(100_000)


def crashes(robot: cohelm.RobotModel, period: float):
    """Takes its process with it."""
    return lambda now: os._exit(3)


def solves(robot: cohelm.RobotModel, period: float):
    """Fails deep inside of a library."""
    return lambda now: np.linalg.inv(np.zeros((2, 2)))


def unmade(robot: cohelm.RobotModel, period: float):
    """Fails before it has a law."""
    return 1 / 0


made = []


def moody(robot: cohelm.RobotModel, period: float):
    """Drives once, and raises whenever it is driven again."""

    def law(now: cohelm.Observation) -> cohelm.Twist:
        if now.t == 0.0:
            made.append(robot)
        return cohelm.Twist(0.2 if len(made) == 1 else 1 / 0, 0.0)

    return law


def restless(robot: cohelm.RobotModel, period: float):
    """Another drive each time."""
    made.append(robot)
    return lambda now: cohelm.Twist(0.1 * len(made), 0.0)


def test_an_external_law_is_judged_like_ours_and_replayed_equally():
    bare = chunk(ROOMS, f"{HERE}:ram", (0, 1, 2))
    safe = chunk(ROOMS, f"{HERE}:filtered", (0,))  # which stands for two minutes in the others
    assert [row.fault for row in (*bare, *safe)] == [""] * 4
    assert sum(row.contacts_moving for row in bare) > 0
    assert sum(row.contacts_moving for row in safe) == 0
    assert all(row.limit_excess == 0.0 for row in (*bare, *safe))
    assert all(math.isnan(row.filtered_share) for row in (*bare, *safe))  # nobody knows
    assert drive(ROOMS.case(0), safe[0]).same


def test_a_law_may_have_processes_of_its_own():
    assert chunk(ROOMS, f"{HERE}:employs", (0,))[0].fault == ""


@pytest.mark.parametrize(
    ("law", "said"),
    first(
        [
            ("leaves", r"SystemExit: 0 \(test_external_law.py:\d+\)"),
            ("forgets", r"the controller must return a Twist \(v, omega\), got None at t = 1.00 s"),
            ("asks_wrongly", r"placed takes a cohelm.Pose\(x, y, psi\), got None"),
            (
                "solves",
                r"LinAlgError: Singular matrix \(test_external_law.py:\d+, .*linalg.py:\d+\)",
            ),
            ("hangs", r"the law did not answer within 1 s \(300 s .* time\) at t = 1.00 s"),
            ("crashes", r"the law ended its process \(it exited with code 3\) at t = 0.00 s"),
        ],
        5,
    ),
)
def test_a_law_that_ends_in_any_way_has_failed_that_episode_and_no_other(law, said, monkeypatch):
    monkeypatch.setattr(apart, "_LATER", 1.0)
    rows = chunk(ROOMS, f"{HERE}:{law}", (0, 1))
    assert [row.episode for row in rows] == [0, 1]
    for row in rows:
        assert re.fullmatch(said, row.fault), row.fault
        assert (row.suite, row.plant, row.law) == ("random", "kinematic", f"{HERE}:{law}")
    until = time.monotonic() + 20.0
    while any(map(_sleeps, Path("/proc").glob("[0-9]*/cmdline"))):
        assert time.monotonic() < until
        time.sleep(0.05)


def _sleeps(command: Path) -> bool:
    with contextlib.suppress(OSError):  # it has ended meanwhile
        return command.read_bytes() == b"sleep\x0098765\x00"
    return False


@pytest.mark.slow  # one that hangs is ended: above
def test_a_law_that_hangs_ends_with_whoever_drives_it(tmp_path):
    """Compiled code keeps the whole interpreter: it is the kernel that ends it."""
    told = tmp_path / "pid"
    driven = f"from {HERE} import *; chunk(ROOMS, HERE + ':tells', (0,))"
    with subprocess.Popen([sys.executable, "-c", driven], env=os.environ | {"TOLD": told}) as one:
        try:
            while not told.exists():
                assert one.poll() is None
                time.sleep(0.05)
        finally:
            one.kill()
    status, until = Path(f"/proc/{told.read_text()}/status"), time.monotonic() + 20.0
    while status.exists() and "zombie" not in status.read_text():
        assert time.monotonic() < until
        time.sleep(0.05)


@pytest.mark.slow  # one that hangs is ended: above
def test_the_answer_of_an_interrupted_drive_is_not_taken_for_that_of_the_next(monkeypatch):
    """As after Ctrl-C in a notebook."""

    def interrupted(_child, _most):
        raise KeyboardInterrupt

    with monkeypatch.context() as during:
        during.setattr(Child, "wait", interrupted)
        with pytest.raises(KeyboardInterrupt):
            chunk(ROOMS, f"{HERE}:ram", (0,))
    next_, again = (chunk(ROOMS, f"{HERE}:ram", (1,)) for _ in range(2))
    assert repr(next_) == repr(again)


def test_a_fault_is_one_readable_line_however_long_its_error_and_deep_its_calls():
    def deep(left: int) -> None:
        if left:
            deep(left - 1)
        raise RuntimeError("no solution " + "of this\n" * 1000)

    try:
        deep(100)
    except RuntimeError as error:
        said = fault_of(error)
    assert said.startswith("RuntimeError: no solution of this of this")
    assert len(said) < 700
    places = re.findall(r"(\w+\.py):(\d+)", said)
    assert len(places) == 6  # the first five, and where it was raised
    assert {name for name, _ in places} == {"test_external_law.py"}
    assert places[1] != places[-1]
    assert " ...)" not in said
    assert said.isprintable()


def test_a_law_that_is_not_there_fails_no_episode_but_all_of_it():
    """As on a worker of a cluster that lacks it: rows that failed would stay."""
    with pytest.raises(CohelmError, match="can not be imported"):
        chunk(ROOMS, f"{HERE}:gone", (0,))


@pytest.mark.parametrize(
    ("law", "said"),
    [
        ("moody", "driven again for this picture it failed: ZeroDivisionError"),
        ("restless", "driven again for this picture it came out otherwise"),
    ],
)
def test_a_law_that_is_not_the_same_again_is_reported_so(law, said, tmp_path):
    made.clear()
    plan = CampaignConfig("random", (f"{HERE}:{law}",), 1, 1)
    suite_, rows = run(plan, tmp_path, 1, None, lambda *_: None)
    assert rows[0].fault == ""
    found = report.outcome(suite_, plan.laws, rows, {})
    page = report.write(found, tmp_path, lambda *_: None)
    assert said in page.read_text()
    made.append(None)
    if law == "moody":
        with pytest.raises(CohelmError, match=r"fails when it is driven again: ZeroDivision.*\.py"):
            again(tmp_path, "0")
    else:
        assert not again(tmp_path, "0")[0].same


def test_a_row_that_failed_can_be_driven_again_and_fails_in_a_sentence(tmp_path):
    run(CampaignConfig("random", (f"{HERE}:leaves",), 1, 1), tmp_path, 1, None, lambda *_: None)
    with pytest.raises(CohelmError) as error:
        again(tmp_path, "0")
    said = f"{HERE}:leaves/0 fails when it is driven again: SystemExit: 0 "
    assert str(error.value).startswith(said)


@pytest.mark.parametrize("beside", first([True, False]))
def test_rows_of_a_law_that_was_changed_since_are_refused(tmp_path, monkeypatch, beside):
    """Also where the change is in a file beside it, or in its package."""
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "gains_of_mine.py").write_text("V = 0.0")
    text = (
        "from gains_of_mine import V\nimport cohelm\n"
        "def make(robot, period):\n    return lambda now: cohelm.Twist(V, 0.0)\n"
    )
    (tmp_path / "law_of_mine.py").write_text(text)
    plan = CampaignConfig("movers", ("law_of_mine:make",), 1, 1)
    try:
        _, (stood,) = run(plan, tmp_path / "out", 1, None, lambda *_: None)
        _, (again,) = run(plan, tmp_path / "out", 1, None, lambda *_: None)
        changed, text = ("gains_of_mine", "V = 0.5") if beside else ("law_of_mine", text + "\n#")
        (tmp_path / f"{changed}.py").write_text(text)
        own_code.cache_clear()  # as in a process of its own
        with pytest.raises(CohelmError, match="another version of your law"):
            run(plan, tmp_path / "out", 1, None, lambda *_: None)
    finally:
        for name in ("law_of_mine", "gains_of_mine"):
            sys.modules.pop(name, None)
    assert stood.path_length_m == again.path_length_m == 0.0


def test_the_code_of_a_law_in_a_package_is_all_of_the_package(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    inner = tmp_path / "laws_of_mine" / "inner"
    inner.mkdir(parents=True)
    for folder in (inner.parent, inner):
        (folder / "__init__.py").write_text("")
    (inner / "law.py").write_text("def make(robot, period):\n    return print\n")
    try:
        before = own_code("laws_of_mine.inner.law:make")
        (inner.parent / "gains.py").write_text("V = 1.0")
        own_code.cache_clear()
        assert own_code("laws_of_mine.inner.law:make") != before
    finally:
        for name in [name for name in sys.modules if name.startswith("laws_of_mine")]:
            del sys.modules[name]


@pytest.mark.parametrize(
    ("law", "plan", "said"),
    [
        ("mine", {}, "there is no law 'mine': choose guard, .* or give package:factory"),
        (f"{HERE}:gone", {}, "can not be imported"),
        (f"{HERE}:number", {}, "must be a function"),
        ("os:system", {}, r"os:system must be a function .*, and made none: TypeError: system\("),
        ("builtins:print", {}, "made none: it returned NoneType, which can not be called"),
        (f"{HERE}:unmade", {}, r"made none: ZeroDivisionError.* \(test_external_law.py:\d+\)"),
        (f"{HERE}:ram", {"plant": "twin"}, "a law of your own drives to a goal"),
        (f"{HERE}:ram", {"suite": "adversary"}, "a law of your own drives to a goal"),
    ],
)
def test_no_law_that_can_not_drive_is_begun_with(law, plan, said):
    given = {"suite": "random", "laws": (law,), "seed": 1, "n": 1} | plan
    with pytest.raises(CohelmError, match=said):
        CampaignConfig(**given).prepared()
