"""Nothing but real numbers passes for an array of them."""

import numpy as np
import pytest

from cohelm.core.arrays import floats
from cohelm.core.errors import CohelmError

TABLE = np.array([[1.0, 2.0], [3.0, 4.0]])


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (TABLE + 0j, "complex128"), ([[1j, 2.0]], "complex128"), ([["1", "2"]], "<U1"),
        (np.array([["2026-01-01", "2026-01-02"]], "M8[s]"), "datetime64"),
        (np.array([[1, 2]], "m8[s]"), "timedelta64"), ([[10**400, 1]], "too large"),
        ([[1.0], [1.0, 2.0]], "rows of one length"), ({1: 2}, "'dict'"),
        (np.ma.array(TABLE, mask=[[0, 0], [0, 1]]), "points: some are masked"),
        (np.ma.masked, "some are masked"),
    ],
)  # fmt: skip
def test_what_is_no_real_number_or_is_masked_is_refused(given, said):
    """NumPy would drop an imaginary part and a mask, and read text."""
    with pytest.raises(CohelmError, match=said):
        floats("points", given)


@pytest.mark.parametrize(
    "given",
    [
        TABLE.astype(np.float32), TABLE.astype(int), TABLE.astype(object), TABLE.astype(">f8"),
        np.asfortranarray(TABLE), np.repeat(TABLE, 2, axis=1)[:, ::2], np.ma.array(TABLE),
    ],
)  # fmt: skip
def test_numbers_of_any_kind_and_order_are_taken(given):
    made = floats("points", given)
    assert made.dtype == np.float64
    assert made.flags.carray
    assert (made == TABLE).all()
    assert floats("points", TABLE) is TABLE
