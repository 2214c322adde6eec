import numpy as np

from cohelm.core.row import ROW
from cohelm.core.trace import Trace


def test_joining_two_pieces_keeps_every_step_in_order():
    whole = np.zeros(5, dtype=ROW)
    whole["t"] = np.arange(5) * 0.01
    h, discs = np.arange(10.0).reshape(5, 2), np.arange(60.0).reshape(5, 2, 6)
    first = Trace(whole[:2], h[:2], discs[:2], ("a", "b"), 0.01, "scenario")
    both = first.joined(Trace(whole[2:], h[2:], discs[2:], ("a", "b"), 0.01, "scenario"))
    assert len(both) == 5
    assert (both.rows == whole).all()
    assert (both.h == h).all()
    assert (both.discs == discs).all()
    assert (both.names, both.dt, both.scenario) == (("a", "b"), 0.01, "scenario")
