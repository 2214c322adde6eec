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
from pathlib import Path
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


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Freeze what is there, and let what watches the clock go first."""
    global _frozen
    _give_way(item)
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
    for item in items:
        quick = _quick(item.path, config.rootpath / "tests")
        if quick and item.get_closest_marker("slow") is None:
            item.add_marker(pytest.mark.quick)


@functools.cache
def _quick(file: Path, tests: Path) -> bool:
    where = file.relative_to(tests).as_posix() if tests in file.parents else ""
    quick = where.startswith(tuple(f"{folder}/" for folder in QUICK))
    return quick and not where.endswith(NOT_QUICK)


WATCHING = {"gw0", "gw1"}
"""The workers that run what watches the clock, which mostly waits: side by side, and first."""
REALTIME, STATION, LONGEST = "realtime", "tests/station/", "wheel"
LOW = 10
"""The niceness of all others, and of these when they have none of it left."""


@pytest.hookimpl(optionalhook=True)  # the mutants are run without xdist
def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """So there are two workers more than cores."""
    return len(WATCHING) + (os.cpu_count() or 1)


GROUP = r'xdist_group\("(\w+)"\)'
MARKED = re.compile(rf"^@pytest\.mark\.{GROUP}\n(?:@.*\n)*def (\w+)", re.MULTILINE)
"""A test that is marked by itself, and not with its file."""


@functools.cache
def _groups(file: Path) -> tuple[str, dict[str, str]]:
    """The group of a file's tests, if they have one, and of those that have one of their own."""
    text = file.read_text()
    own = {match[2]: match[1] for match in MARKED.finditer(text)}
    whole = re.search(GROUP, MARKED.sub("", text))
    return whole[1] if whole else "", own


def _group(root: Path, test: str) -> str:
    """Of a test, by its node id; its file, where it has none."""
    file, _, name = test.partition("::")
    whole, own = _groups(root / file)
    return own.get(name.partition("[")[0], whole) or file


def _give_way(item: pytest.Item) -> None:
    """A worker that has nothing left that watches the clock takes what is left of the cores."""
    here, root = (os.PRIO_PROCESS, 0), item.config.rootpath
    if hasattr(item.config, "workerinput") and _group(root, item.nodeid) != REALTIME:
        os.setpriority(*here, max(os.getpriority(*here), LOW))


class ByFile(LoadScopeScheduling):
    """Each file to one worker, with those of its group; tests that are marked by themselves, with
    theirs; what watches the clock, to two workers. The longest group of the others begins first:
    nobody waits for it at the end.

    One after another, those that watch the clock take longer than all others: so two at a time,
    file by file (those of the station together, which share a robot and a browser).

    pytest-xdist 3.8 tells groups by a name of tests that pytest 9.2 reads no more.
    """

    def _assign_work_unit(self, node: WorkerController) -> None:
        first = node.gateway.id in WATCHING
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
        there = {one.gateway.id for one in self.nodes} & WATCHING
        if not watching or not there or node.gateway.id in there:
            super()._reschedule(node)
        elif not node.shutting_down:
            node.shutdown()  # when it has ended what it has

    def _split_scope(self, nodeid: str) -> str:
        group = _group(self.config.rootpath, nodeid)
        if group != REALTIME:
            return group
        file = nodeid.partition("::")[0]
        return f"{REALTIME} {STATION if file.startswith(STATION) else file}"


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> Any:
    """What `--dist loadgroup` does here."""
    return ByFile(config, log) if config.getoption("dist") == "loadgroup" else None


# Started in the background of a shell, a process ignores Ctrl-C, and so would all that tests start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
