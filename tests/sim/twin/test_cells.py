"""A map's solid cells are covered by rectangles, each once."""

import numpy as np
from hypothesis import given
from hypothesis.extra import numpy as arrays

from cohelm.sim.twin.mjcf import rectangles

MAPS = arrays.arrays(bool, arrays.array_shapes(min_dims=2, max_dims=2, max_side=12))


@given(MAPS)
def test_rectangles_cover_the_solid_cells_and_only_them_once(solid):
    count = np.zeros(solid.shape, dtype=int)
    for row, column, row_end, column_end in rectangles(solid):
        assert row < row_end
        assert column < column_end
        count[row:row_end, column:column_end] += 1
    assert (count == solid).all()


def test_a_room_is_a_few_rectangles_not_many_cells():
    room = np.ones((100, 150), dtype=bool)
    room[2:-2, 2:-2] = False
    assert len(rectangles(room)) == 4


def test_an_empty_map_has_none():
    assert rectangles(np.zeros((0, 0), dtype=bool)).shape == (0, 4)
