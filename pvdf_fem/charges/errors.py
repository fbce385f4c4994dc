"""How wrong charges are, from the estimated errors of their two forces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Of the mean relative error of a solution's charges: no charge is stated to have less.
CHANCE = 0.25


def charge_errors(forces: Array, force_errors: Array, d: Sequence[float]) -> Array:
    """Estimated errors d31 dX + d32 dY of charges, (goals,), in the units of d times those of X.

    An estimate may vanish by chance. The charges are of one displacement, whose error they share,
    so none is taken for much better than they are in the mean.

    Parameters
    ----------
    forces, force_errors : (goals, 2)
        X, Y of a solution's electrodes, and their estimated errors with their signs.
    d : (d31, d32)
    """
    sizes, errors = np.abs(forces * d).sum(axis=1), np.abs(force_errors @ d)
    total = sizes.sum()
    mean = errors.sum() / total if total > 0.0 else 0.0
    return np.asarray(np.maximum(errors, CHANCE * mean * sizes))
