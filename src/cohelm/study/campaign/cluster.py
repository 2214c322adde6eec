"""Drives episodes on an existing Dask cluster (`--cluster ADDRESS`).

Every worker needs the same cohelm, installed with its extra `cluster`; the data are sent to them. A
chunk whose worker dies is driven by another one; only a chunk driven to its end returns its rows,
and they are counted by law and number, so nothing is lost or counted twice.
"""

from __future__ import annotations

import pickle
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from hashlib import sha256
from typing import Any

import distributed
from distributed import Client, WorkerPlugin
from distributed.comm.addressing import parse_address, parse_host_port

from cohelm.core.errors import CohelmError
from cohelm.study.campaign.result import EpisodeResult
from cohelm.study.campaign.suites import Suite
from cohelm.study.campaign.worker import chunk, code

_PATIENCE = 10.0  # for a scheduler to answer [s]
_held: dict[str, Suite] = {}
"""Of a worker: the suites it was sent, by digest."""


@contextmanager
def driven_on(
    address: str, made: Suite, work: list[tuple[str, tuple[int, ...]]]
) -> Generator[Iterator[list[EpisodeResult]]]:
    """The rows of the work as they come from the cluster at `address`.

    Raises CohelmError where no scheduler answers, there is no worker, a worker runs other code,
    or a chunk has ended several workers.
    """
    try:
        # checked first: of a wrong one the client would leave half of itself
        parse_host_port(parse_address(address)[1])
        client: Any = Client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise CohelmError(
            f"--cluster {address}: no Dask scheduler answers there ({error}); start one with "
            "`dask scheduler` and give its address, like tcp://host:8786"
        ) from error
    try:
        if not client.scheduler_info()["workers"]:
            raise CohelmError(
                f"--cluster {address}: the scheduler has no worker; start some with "
                f"`dask worker {address}` where this cohelm is installed"
            )
        packed = pickle.dumps(made)
        name = sha256(packed).hexdigest()[:16]
        client.register_plugin(_Holder(packed, name, code()), name=f"cohelm-{name}")
        yield _as_they_come(client, name, work)
    finally:
        client.close(timeout=_PATIENCE)


def _as_they_come(
    client: Any, name: str, work: list[tuple[str, tuple[int, ...]]]
) -> Iterator[list[EpisodeResult]]:
    futures = [
        client.submit(_on_worker, name, law, numbers, pure=False, key=f"{name}-{law}-{numbers[0]}")
        for law, numbers in work
    ]
    try:
        done: Any = distributed.as_completed(futures, loop=client.loop)
        for future in done:
            yield [EpisodeResult(*values) for values in future.result()]
            future.release()
    except distributed.KilledWorker as error:
        raise CohelmError(
            "several workers died while they drove the same episodes, perhaps for want of memory; "
            "what was driven is kept: give the same command again"
        ) from error
    finally:
        client.cancel(futures)


class _Holder(WorkerPlugin):
    """Brings a suite to every worker, those that join later too."""

    def __init__(self, packed: bytes, name: str, code: str) -> None:
        self.packed, self.name, self.code = packed, name, code

    def setup(self, worker: Any) -> None:
        """On a worker, once."""
        if code() != self.code:
            raise CohelmError(
                f"the worker {worker.address} runs another version of cohelm; install this one"
            )
        _held[self.name] = pickle.loads(self.packed)


def _on_worker(name: str, law: str, numbers: tuple[int, ...]) -> list[tuple[Any, ...]]:
    return [tuple(row) for row in chunk(_held[name], law, numbers)]
