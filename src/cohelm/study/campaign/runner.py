"""Runs a whole campaign: drives what is missing, on processes or a cluster, and keeps the rows."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Generator, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from multiprocessing import active_children, get_context
from pathlib import Path
from typing import Any

from cohelm import __version__
from cohelm.core.errors import CohelmError, did_you_mean
from cohelm.core.extras import missing
from cohelm.core.plugins import plugins
from cohelm.core.types import Progress
from cohelm.robot.keep.processes import end_with_parent
from cohelm.robot.model import RobotModel
from cohelm.study.campaign.laws import GROUP, check_made, factory, is_own, own_code
from cohelm.study.campaign.result import EpisodeResult
from cohelm.study.campaign.store import PLAN, Key, Store, read_plan
from cohelm.study.campaign.suites import Suite, suite
from cohelm.study.campaign.worker import chunk, code, commit

Work = tuple[str, tuple[int, ...]]
"""A law, and the numbers of the episodes to drive under it."""

_FLUSH = 1.0  # rows are on the disk after at most so long [s]
_MOST = 1_000_000
_PER_PROCESSOR = 4  # processes at most: each takes some 260 MB


@dataclass(frozen=True)
class CampaignConfig:
    """The plan of a campaign."""

    suite: str
    laws: tuple[str, ...]
    seed: int
    n: int | None = None
    """Episodes under each law; None for as many as the suite has by default."""
    data: Path | None = None
    plant: str | None = None
    robot: RobotModel | None = None
    """Both: None for the suite's own."""

    def prepared(self) -> Suite:
        """The suite, read and checked against the rest of the plan."""
        if self.n is not None and not 1 <= self.n <= _MOST:
            raise CohelmError(f"--n must be between 1 and {_MOST}, got {self.n}")
        if not 0 <= self.seed < 2**32:
            raise CohelmError(f"--seed must be between 0 and 2**32 - 1, got {self.seed}")
        made = suite(self.suite, self.seed, self.data, self.plant, self.robot)
        if not all(self.laws):
            raise CohelmError(f"name each law between the commas: {', '.join(made.laws)}")
        if not self.laws or len(set(self.laws)) < len(self.laws):
            raise CohelmError(f"give each law once: {', '.join(made.laws)}")
        for law in self.laws:
            if is_own(law):
                self._own(law, made)
            elif law not in made.laws:
                raise CohelmError(
                    f"{law} does not drive in the suite {self.suite} with --plant {made.plant}: "
                    f"choose {', '.join(made.laws)}"
                )
        return made

    def _own(self, law: str, made: Suite) -> None:
        """Checks that an external law exists, and can be given the true obstacles."""
        if ":" not in law and law not in plugins(GROUP):
            there = [*made.laws, *plugins(GROUP)]
            raise CohelmError(
                f"there is no law {law!r}: choose {', '.join(there)}, or give package:factory"
                f"{did_you_mean(law, there)}"
            )
        if made.plant != "kinematic" or not made.goals:
            raise CohelmError(
                f"{law} does not drive in the suite {self.suite} with --plant {made.plant}: a law "
                "of your own drives to a goal, with --plant kinematic"
            )
        factory(law)
        check_made(law, made.case(0))

    def as_dict(self, made: Suite) -> dict[str, Any]:
        """As the campaign's folder keeps it. made: what `prepared` returned."""
        return {
            "suite": self.suite,
            "laws": list(self.laws),
            "seed": self.seed,
            "n": self.n or made.episodes,
            "data": None if self.data is None else str(self.data.resolve()),
            "plant": made.plant,
            "robot": self.robot and self.robot.model_dump(mode="json", exclude_defaults=True),
            "code": code(),
            "data_digest": made.data,
            "own": {law: own_code(law) for law in self.laws if is_own(law)},
            "version": __version__,
            "commit": commit(),
            "began": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        }


def planned(folder: Path) -> CampaignConfig:
    """The plan that a campaign's folder keeps. Raises CohelmError where there is none."""
    kept = read_plan(folder)
    if kept is None:
        raise CohelmError(f"{folder}: holds no campaign; give a suite or a campaign's folder")
    try:
        data = None if kept["data"] is None else Path(str(kept["data"]))
        laws = tuple(str(law) for law in kept["laws"])
        plant, robot = str(kept["plant"]), kept.get("robot")
        model = None if robot is None else RobotModel.model_validate(robot)
        suite, seed, n = str(kept["suite"]), int(kept["seed"]), int(kept["n"])
        return CampaignConfig(suite, laws, seed, n, data, plant, model)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise CohelmError(
            f"{folder / PLAN}: is not a campaign's plan; choose another folder"
        ) from error


def run(
    plan: CampaignConfig, folder: Path, jobs: int, cluster: str | None, progress: Progress
) -> tuple[Suite, list[EpisodeResult]]:
    """Drive the missing episodes, and return all rows, by law and number.

    Interrupted, killed or on a full disk, the rows written before stay, and the same call goes on
    with the rest. jobs: processes on this machine. cluster: address of a Dask scheduler to drive on
    instead.
    """
    made = check(plan, jobs)
    episodes = plan.n or made.episodes
    with Store(folder, plan.as_dict(made)) as store:
        work = remaining(plan.laws, episodes, made.chunk, set(store.rows))
        if work:
            with workers(made, work, jobs, cluster) as done:
                _gather(done, store, len(plan.laws) * episodes, progress)
        rows = [store.rows[law, k] for law in plan.laws for k in range(episodes)]
    return made, rows


def check(plan: CampaignConfig, jobs: int) -> Suite:
    """The suite of a plan; raises CohelmError for what `run` could not begin with."""
    most = _PER_PROCESSOR * processors()
    if not 1 <= jobs <= most:
        raise CohelmError(
            f"--jobs must be between 1 and {most}, {_PER_PROCESSOR} for each processor here, got "
            f"{jobs}: more take memory and no less time"
        )
    return plan.prepared()


def processors() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def remaining(
    laws: tuple[str, ...], episodes: int, size: int, there: set[Key]
) -> list[Work]:  # fmt: skip
    """The missing episodes, in chunks; each episode under all laws before the next."""
    work: list[Work] = []
    for first in range(0, episodes, size):
        for law in laws:
            numbers = tuple(
                k for k in range(first, min(first + size, episodes)) if (law, k) not in there
            )
            if numbers:
                work.append((law, numbers))
    return work


@contextmanager
def workers(
    made: Suite, work: list[Work], jobs: int, cluster: str | None
) -> Generator[Iterator[list[EpisodeResult]]]:
    """The rows of the work as they come, in any order, from wherever they are driven."""
    if cluster is not None:
        try:
            from cohelm.study.campaign.cluster import driven_on
        except ImportError as error:
            raise missing("--cluster, here and on every worker,", "cluster") from error
        with driven_on(cluster, made, work) as rows:
            yield rows
    elif jobs == 1:
        yield (chunk(made, law, numbers) for law, numbers in work)
    else:
        with _processes(made, work, jobs) as rows:
            yield rows


def _gather(
    done: Iterator[list[EpisodeResult]], store: Store, total: int, progress: Progress
) -> None:
    """Keep rows as they come, at most _FLUSH late, whatever ends it."""
    fresh: list[EpisodeResult] = []
    before, begin, flushed = len(store.rows), time.monotonic(), time.monotonic()
    contacts = sum(row.contacts_moving > 0 for row in store.rows.values())
    progress("driving (the first time, compiling)", before / total)
    try:
        for rows in done:
            fresh += rows
            contacts += sum(row.contacts_moving > 0 for row in rows)
            now = time.monotonic()
            if now - flushed > _FLUSH:
                store.add(fresh)
                fresh, flushed = [], now
            there = len(store.rows) + len(fresh)
            left = (now - begin) * (total - there) / max(there - before, 1)
            progress(
                f"{there} of {total}, {contacts} with a moving contact, {_about(left)} left",
                there / total,
            )
    finally:
        store.add(fresh)


def _about(seconds: float) -> str:
    if seconds < 100.0:
        return f"about {seconds:.0f} s"
    return f"about {seconds / 60.0:.0f} min" if seconds < 6000.0 else f"{seconds / 3600.0:.1f} h"


@contextmanager
def _processes(
    made: Suite, work: list[Work], jobs: int
) -> Generator[Iterator[list[EpisodeResult]]]:
    """On processes of this machine, which end when this one does, however it ends."""
    before = set(active_children())
    pool = ProcessPoolExecutor(
        min(jobs, len(work)), get_context("spawn"), _begin, (made,), max_tasks_per_child=None
    )
    try:
        yield _as_they_come(pool, work, 2 * jobs)
        pool.shutdown()
    except BaseException:  # Ctrl-C first of all: do not wait for what is being driven
        children = set(active_children()) - before
        for child in children:
            child.terminate()
        # Its thread has to end too: Python ending beside it writes to what it closes.
        pool.shutdown(cancel_futures=True)
        for child in children:
            child.join()
        raise


def _as_they_come(
    pool: ProcessPoolExecutor, work: list[Work], most: int
) -> Iterator[list[EpisodeResult]]:  # fmt: skip
    """Rows as they come, with `most` chunks handed out at any time."""
    out: set[Future[list[EpisodeResult]]] = set()
    queue = iter(work)
    try:
        while True:
            while len(out) < most and (item := next(queue, None)) is not None:
                out.add(pool.submit(_in_process, *item))
            if not out:
                return
            ended, out = wait(out, return_when=FIRST_COMPLETED)
            for future in ended:
                yield future.result()
    except BrokenProcessPool as error:
        raise CohelmError(
            "a process of the campaign was killed from outside, perhaps for want of memory; what "
            "was driven is kept: give the same command again, perhaps with fewer --jobs"
        ) from error


_suite: Suite | None = None
"""Of a worker process: what it drives."""


def _begin(made: Suite) -> None:
    """In a worker process: leave Ctrl-C to the parent, and end when it does."""
    global _suite
    _suite = made
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()


def _in_process(law: str, numbers: tuple[int, ...]) -> list[EpisodeResult]:
    assert _suite is not None
    return chunk(_suite, law, numbers)
