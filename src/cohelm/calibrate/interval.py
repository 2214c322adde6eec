"""Confidence intervals of a least-squares fit whose errors are correlated within clusters.

The usual formula takes each error as independent. A motion's are not: a ramp that begins late is
late at every reading of it. So errors are added up motion by motion before they are squared (the
"sandwich" for clustered data: Liang and Zeger 1986, https://doi.org/10.1093/biomet/73.1.13), and
with few motions Student's t counts instead of the normal distribution. Clusters that happen to
cancel would make that too small: the larger of both formulas is taken. An error common to all
motions is in neither.

Motions known to err alike, as between the same two places, count as one cluster: driving the same
way again measures nothing new.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri, stdtrit  # `scipy.stats`, which has them too, takes 0.4 s to import

from cohelm.core.types import Floats, Ints

_LEVEL = 0.975  # both tails of 95 %


def half_widths(jacobian: Floats, residuals: Floats, lump: Ints, of: Floats) -> Floats:
    """Half of the 95 % interval of each sum of parameters, (k,).

    jacobian: (n, m), of residuals (n,) that are weighted to be about 1. lump: (n,), to which lump
    each residual belongs. of: (k, m), the sums.
    """
    bread = np.linalg.pinv(jacobian.T @ jacobian)
    lumps = np.unique(lump)
    scores = np.array([jacobian[lump == one].T @ residuals[lump == one] for one in lumps])
    count = len(lumps)
    meat = scores.T @ scores * (count / max(count - 1, 1))
    size = max(float(np.mean(residuals**2)), 1e-12)
    spread = [np.einsum("ki,ij,kj->k", of, c, of) for c in (size * bread, bread @ meat @ bread)]
    wide = float(stdtrit(max(count - 1, 1), _LEVEL))
    return wide * np.sqrt(np.maximum(np.maximum(*spread), 0.0))


def half_widths_alike(jacobian: Floats, residuals: Floats, lump: Ints) -> Floats:
    """Half of the 95 % interval of each parameter, (m,), if motions of a lump err alike.

    jacobian: (n, c, m), of residuals (n, c), c for each motion. lump: (n,), of each motion.
    """
    flat = jacobian.reshape(-1, jacobian.shape[2])
    bread = np.linalg.pinv(flat.T @ flat)
    size = np.sqrt(np.mean(residuals**2, axis=0))
    sums = np.array([jacobian[lump == one].sum(axis=0) for one in np.unique(lump)])
    scores = (size[None, :, None] * sums).reshape(-1, jacobian.shape[2]) @ bread
    return float(ndtri(_LEVEL)) * np.sqrt(np.sum(scores**2, axis=0))
