import numpy as np
import scipy
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays

from cohelm.plan.distance_transform import NONE, nearest_occupied

grids = st.tuples(st.integers(1, 40), st.integers(1, 40)).flatmap(
    lambda shape: arrays(np.bool_, shape, elements=st.integers(0, 19).map(lambda n: n == 0))
)


@given(grids)
def test_the_nearest_occupied_cell_is_as_near_as_scipys(occupied):
    nearest = nearest_occupied(occupied)
    if not occupied.any():
        assert (nearest == NONE).all()
        return
    i, j = np.divmod(nearest, occupied.shape[1])
    assert occupied[i, j].all()
    rows, columns = np.indices(occupied.shape)
    found = np.sqrt((i - rows) ** 2.0 + (j - columns) ** 2.0)
    assert (found == scipy.ndimage.distance_transform_edt(~occupied)).all()
