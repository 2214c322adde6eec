"""Which tests are quick, and Hypothesis profiles.

`make test-all` tries five times as many examples, `pytest --hypothesis-profile=thorough` digs; CI
repeats its examples.
"""

import functools
import gc
import itertools
import os
import re
import signal
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from xdist.remote import Producer
from xdist.scheduler import LoadScopeScheduling
from xdist.workermanage import WorkerController

from tests.typed import cohelm as cohelm  # for all folders

_calm = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("default", max_examples=40, **_calm)
settings.register_profile("ci", max_examples=40, derandomize=True, print_blob=True, **_calm)
settings.register_profile("more", max_examples=300, **_calm)
settings.register_profile("thorough", max_examples=5000, **_calm)
settings.load_profile("ci" if os.environ.get("CI") else "default")

# A worker comes to hold millions of objects, and Python looks through them all again and again:
# tests took up to three times as long in it as alone. So what all have imported is frozen; a drive
# in real time lets it go at its end (`robot/keep/garbage.py`), and once in so many times what
# earlier tests left is then collected before.
gc.set_threshold(300_000, 20, 20)
_COLLECTED = itertools.cycle([False] * 9 + [True])
_frozen, _unfreeze = False, gc.unfreeze


def _let_go() -> None:
    """Noted here: Python's own count of what is frozen goes through it all."""
    global _frozen
    _frozen = False
    _unfreeze()


gc.unfreeze = _let_go


def pytest_runtest_setup() -> None:
    """Freeze what is there."""
    global _frozen
    if not _frozen:
        if next(_COLLECTED):
            gc.collect()
        gc.freeze()
        _frozen = True


QUICK = ("api", "core", "law", "robot/gate", "scenario")
"""Folders whose tests one runs at every change: `pytest -m quick`."""
NOT_QUICK = (
    "test_mutants.py", "test_examples.py", "api/test_drive.py", "api/test_robot.py",
    "core/test_jit.py",
)  # fmt: skip
"""... but for what starts processes there, or drives in real time."""


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark what is quick."""
    tests = config.rootpath / "tests"
    for item in items:
        where = item.path.relative_to(tests).as_posix() if tests in item.path.parents else ""
        quick = where.startswith(tuple(f"{folder}/" for folder in QUICK))
        quick = quick and not where.endswith(NOT_QUICK)
        if quick and item.get_closest_marker("slow") is None:
            item.add_marker(pytest.mark.quick)


FIRST, SECOND = "gw0", "gw1"
"""The worker that runs what watches the clock; and the one that helps it at the end."""
REALTIME, STATION, LONGEST = "realtime", "tests/station/", "wheel"


@pytest.hookimpl(optionalhook=True)  # the mutants are run without xdist
def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """What watches the clock mostly waits: one worker more than there are cores."""
    return 1 + (os.cpu_count() or 1)


def pytest_configure(config: pytest.Config) -> None:
    """The other workers take what the first one leaves of the cores."""
    worker = getattr(config, "workerinput", {"workerid": FIRST})["workerid"]
    os.nice({FIRST: 0, SECOND: 5}.get(worker, 10))


GROUP = r'xdist_group\("(\w+)"\)'
MARKED = re.compile(rf"^@pytest\.mark\.{GROUP}\n(?:@.*\n)*def (\w+)", re.MULTILINE)
"""A test that is marked by itself, and not with its file."""


class ByFile(LoadScopeScheduling):
    """Each file to one worker, with those of its group; tests that are marked by themselves, with
    theirs; what watches the clock, to the first one. The longest group of the others begins first:
    nobody waits for it at the end.

    One after another, those that watch the clock take longer than all others: file by file (those
    of the station together, which share a robot and a browser) the second worker takes of them as
    soon as nothing else is left, and so nothing else needs its core.

    pytest-xdist 3.8 tells groups by a name of tests that pytest 9.2 reads no more.
    """

    def _assign_work_unit(self, node: WorkerController) -> None:
        first = node.gateway.id == FIRST
        self.workqueue.move_to_end(
            min(
                self.workqueue,
                key=lambda unit: (unit.startswith(REALTIME) != first, unit != LONGEST),
            ),
            last=False,
        )
        super()._assign_work_unit(node)

    def _reschedule(self, node: WorkerController) -> None:
        watching = all(unit.startswith(REALTIME) for unit in self.workqueue)
        there = {one.gateway.id for one in self.nodes} & {FIRST, SECOND}
        if not watching or not there or node.gateway.id in there:
            super()._reschedule(node)
        elif not node.shutting_down:
            node.shutdown()  # when it has ended what it has

    def _split_scope(self, nodeid: str) -> str:
        file, _, test = nodeid.partition("::")
        whole, own = self._groups(file)
        group = own.get(test.partition("[")[0], whole)
        if group != REALTIME:
            return group
        return f"{REALTIME} {STATION if file.startswith(STATION) else file}"

    @functools.cache  # noqa: B019  there is one, for the whole run
    def _groups(self, file: str) -> tuple[str, dict[str, str]]:
        """The group of a file's tests, and of those that have one of their own."""
        text = (self.config.rootpath / file).read_text()
        own = {match[2]: match[1] for match in MARKED.finditer(text)}
        whole = re.search(GROUP, MARKED.sub("", text))
        return whole[1] if whole else file, own


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> Any:
    """What `--dist loadgroup` does here."""
    return ByFile(config, log) if config.getoption("dist") == "loadgroup" else None


# Started in the background of a shell, a process ignores Ctrl-C, and so would all that tests start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
