"""Arrays of numbers, as a caller in Python gives them."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from cohelm.core.errors import CohelmError
from cohelm.core.types import Floats

_NUMBERS = "fiubO"
"""Kinds of arrays that hold real numbers, or objects which may be some."""


def floats(name: str, given: ArrayLike) -> Floats:
    """As compiled code takes it without a new specialization: float64, contiguous, writable. Such
    an array is kept, not copied.

    CohelmError for what NumPy would make numbers of and is none: text, times, the real part of
    complex numbers, and what is under a mask.
    """
    if isinstance(given, np.ma.MaskedArray) and np.ma.getmaskarray(cast("Any", given)).any():
        raise CohelmError(
            f"{name}: some are masked: give .filled(numpy.nan) where nothing was measured, or "
            "leave them out"
        )
    try:
        raw: np.ndarray[Any, Any] = np.asarray(given)
        if raw.dtype.kind not in _NUMBERS:
            raise TypeError(f"got {raw.dtype}")
        made: Floats = np.ascontiguousarray(raw, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        why = str(error).partition(". ")[0]  # of a ragged list NumPy says more
        raise CohelmError(
            f"{name} must be an array of numbers, in rows of one length: {why}"
        ) from error
    return made if made.flags.carray else made.copy()
