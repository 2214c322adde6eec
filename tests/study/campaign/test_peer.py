"""ir-sim's controllers in our rooms, under our judge."""

import importlib.util

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.study.campaign import laws, rooms, rvo
from cohelm.study.campaign.episode import Interventions
from cohelm.study.campaign.suites import suite
from cohelm.study.campaign.worker import chunk

with_peer = pytest.mark.skipif(
    importlib.util.find_spec("irsim") is None, reason="ir-sim is not installed: make bench"
)


@with_peer
def test_the_peer_crosses_a_room_within_the_same_limits_and_the_same_every_time():
    made = suite("random", 1, None)
    first, again = chunk(made, "rvo", (1,))[0], chunk(made, "rvo", (1,))[0]
    assert repr(first) == repr(again)
    assert (first.fault, first.arrived, first.limit_excess) == ("", True, 0.0)
    case = rooms.case(1, 1)
    (trace,) = laws.pieces(case, "rvo", Interventions())
    assert trace.rows["x"][0] == case.setup.start.x
    assert np.abs(trace.rows["applied_v"]).max() <= case.setup.reference.speed + 1e-12
    assert np.ptp(trace.discs[:, -1, :2], axis=0).max() > 0.5  # the walkers walk for it too


def test_the_peers_drive_fields_of_movers_at_the_speed_that_is_wanted_there():
    made = suite("movers", 1, None)
    assert set(rvo.PEERS) <= set(made.laws)
    assert made.case(0).setup.reference.speed == 0.8


@pytest.mark.skipif(
    importlib.util.find_spec("tau_ctrl") is None, reason="see benchmarks/mppi.py: tau-ctrl"
)
def test_sampled_sequences_cross_a_room_within_the_limits_and_the_same_every_time():
    made = suite("random", 1, None)
    first, again = (chunk(made, "benchmarks.mppi:controller", (1,))[0] for _ in range(2))
    assert repr(first) == repr(again)
    assert (first.fault, first.arrived, first.limit_excess) == ("", True, 0.0)


def test_without_the_peer_it_names_what_to_install(monkeypatch):
    monkeypatch.setattr(rvo.importlib.util, "find_spec", lambda _name: None)
    with pytest.raises(CohelmError, match=r"pip install .*ir-sim"):
        chunk(suite("random", 1, None), "rvo", (0,))
