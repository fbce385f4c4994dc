"""Stated errors of drawn scenes are honest."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem import solve
from reports.accuracy.drawn import KINDS, draw_scenes
from tests.helpers.discs import values


@pytest.mark.parametrize("kind", KINDS)
def test_stated_errors_cover_true_ones_in_drawn_scenes(kind):
    """Against ten times finer solves; charges whose parts cancel have a warning, and no tolerance
    of their own."""
    (scene,) = draw_scenes(kind, 1, seed=5)
    solution, fine = (solve(scene.with_(**{"numerics.tolerance": t})) for t in (3e-3, 3e-4))
    exact, stated = values(fine.charges_pC), values(solution.charge_errors_pC)
    errors = np.abs(values(solution.charges_pC) - exact)
    told = errors > 2.0 * values(fine.charge_errors_pC)
    assert (stated > 0.2 * errors)[told].all()
    assert stated.max() < 10.0 * errors.max() + 3.0 * values(fine.charge_errors_pC).max()
    warned = " ".join(solution.warnings)
    plain = [f"charge {name}:" not in warned for name in fine.charges_pC]
    assert (errors <= 1.3 * 3e-3 * np.abs(exact))[plain].all()
