"""Six recorded runs of real people, played into the lab, with records written.

What they did with their stick was meant for another room, so all they can promise is the law's
own: whatever comes, no obstacle's safe distance is entered. The walls, which the law does not
know, are driven through.
"""

from pathlib import Path

import pytest

from cohelm.record.read import read
from cohelm.scenario import build, load
from cohelm.study.metrics import measure
from cohelm.study.single import recorded
from tests.few import first

RUNS = Path(__file__).parents[3] / "shared" / "data" / "stick" / "joystick_runs_10hz.csv.gz"
pytestmark = pytest.mark.skipif(
    not RUNS.exists(), reason="the recorded sticks are not beside this checkout"
)


@pytest.mark.parametrize("run", first(range(6)))
def test_a_real_hand_leads_enters_no_safe_distance_and_is_recorded_whole(tmp_path, run):
    setup = build.setup(load.scenario("lab-shared", stick=f"{RUNS}#{run}"))
    metrics = recorded(setup, tmp_path, lambda _doing, _share: None)
    assert metrics.min_h > 0.0
    assert metrics.invalid_share == 0.0
    assert metrics.min_auto_authority < 0.01
    assert 0.3 < metrics.human_share < 0.9
    trace = read(tmp_path / "record.mcap")
    assert measure(trace) == metrics
    assert trace.scenario == setup.scenario
    assert f"{RUNS.name}#{run}" in trace.scenario
    assert (tmp_path / "run.png").stat().st_size > 50_000
