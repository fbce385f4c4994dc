"""The solution corrected in the next order is near the solution of the next order."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.solution.estimate import Correction, corrected
from pvdf_fem.solvers.budget import Budget
from pvdf_fem.solvers.ladder import equilibrate
from tests.helpers.discs import LOADS, TRIANGLE, graded_mesh


@pytest.mark.parametrize("kind", ["dead", "stuck"])
def test_a_correction_is_most_of_the_way_to_the_next_order(kind):
    """In the energy norm; the smooth steps, taken the other way, would leave half or more."""
    scene = TRIANGLE.with_(**LOADS[kind])
    coarse = Equilibrium(scene, graded_mesh(scene, 6.0, 14.0), 2)
    result = equilibrate(coarse)
    assert result.factors is not None
    rich = coarse.with_(order=3)
    correction = corrected(coarse, result.q, result.factors, rich, Budget.of(scene))
    assert isinstance(correction, Correction)
    assert correction.result is None
    exact = equilibrate(rich, correction.start).q

    def size(change):
        return np.sqrt(change @ rich.action(rich.state(exact), change))

    assert size(correction.q - exact) < 0.2 * size(correction.start - exact)
