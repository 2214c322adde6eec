"""What a search of the whole map goes by."""

import numpy as np

from cohelm.perceive.localize.global_search import search


def test_a_search_goes_by_how_much_wall_is_seen_and_not_by_how_many_beams_fall_on_it():
    """A door leaf right beside the robot takes a quarter of the beams: where it is on no map, the
    right place would fit worse than many wrong ones."""
    leaf = np.column_stack((np.linspace(-0.35, 0.35, 180), np.full(180, -0.6)))
    wall = np.column_stack((np.linspace(-6.0, 6.0, 540), np.full(540, 1.2)))
    chosen = search(np.vstack((leaf, wall)), np.zeros((1, 2)), True).points[0]
    assert len(chosen) > 40
    assert 0.02 < (chosen[:, 1] < 0.0).mean() < 0.12
