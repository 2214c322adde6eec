"""On a real Dask scheduler with two workers, one of which is killed in the middle."""

import os
import signal
import subprocess
import sys
import time
from importlib.util import find_spec

import pytest

from cohelm.core.errors import CohelmError
from cohelm.study.campaign.runner import CampaignConfig, run

# to import it here would take 0.3 s in each worker of the tests
pytestmark = pytest.mark.skipif(not find_spec("distributed"), reason="distributed is not installed")
PLAN = CampaignConfig("adversary", ("guard",), 7, 400)


def quiet(_doing, _share):
    pass


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """Address of a scheduler, and its two workers' processes, on loopback."""
    folder = tmp_path_factory.mktemp("dask")
    env = {**os.environ, "DASK_DISTRIBUTED__ADMIN__LOG_FORMAT": "%(message)s"}
    file = folder / "scheduler.json"
    command = [sys.executable, "-m", "distributed.cli.dask_scheduler"]
    options = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", file]
    with (folder / "log").open("w") as log:
        started = [subprocess.Popen([*command, *options], env=env, stdout=log, stderr=log)]
        try:
            _until(file.exists)
            worker = [
                sys.executable, "-m", "distributed.cli.dask_worker", "--scheduler-file", file,
                "--no-nanny", "--nthreads", "1", "--no-dashboard", "--local-directory", folder,
            ]  # fmt: skip
            started += [subprocess.Popen(worker, env=env, stdout=log, stderr=log) for _ in range(2)]
            import json

            yield json.loads(file.read_text())["address"], started[1:]
        finally:
            for process in reversed(started):
                process.kill()
                process.wait()


def _until(ready):
    end = time.monotonic() + 60.0
    while not ready():
        assert time.monotonic() < end
        time.sleep(0.05)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # Dask's own, of what it found or lost
def test_a_worker_killed_in_mid_campaign_loses_nothing_and_nothing_is_counted_twice(
    cluster, tmp_path
):
    from distributed import Client

    address, workers = cluster
    with Client(address) as client:
        client.wait_for_workers(2, timeout=60)
    seen = []

    def told(doing, share):
        seen.append(share)
        if 0.1 < share < 1.0 and workers[0].poll() is None:
            os.kill(workers[0].pid, signal.SIGKILL)

    _, rows = run(PLAN, tmp_path / "there", 1, address, told)
    workers[0].wait()
    assert workers[0].returncode == -signal.SIGKILL
    assert 0.1 < seen[-1] <= 1.0
    assert [row.episode for row in rows] == list(range(400))
    _, alone = run(PLAN, tmp_path / "alone", 1, None, quiet)
    assert [repr(row) for row in rows] == [repr(row) for row in alone]


@pytest.mark.filterwarnings("ignore")
def test_a_missing_dask_cluster_is_reported_with_the_command_to_start_one(tmp_path, monkeypatch):
    from cohelm.study.campaign import cluster

    monkeypatch.setattr(cluster, "_PATIENCE", 0.5)
    for address in ("tcp://127.0.0.1:1", "nonsense://x"):
        with pytest.raises(CohelmError, match="no Dask scheduler answers"):
            run(PLAN, tmp_path / "there", 1, address, quiet)
