"""What must hold for every scene: similarity, equilibrium, honest error estimates."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from pvdf_fem import solve
from pvdf_fem.solvers.status import Status
from reports.accuracy.drawn import KINDS, drawn_scenes, random_scene
from tests.helpers.damage import drawn
from tests.helpers.discs import LOADS, values

few = drawn(0.05)


@st.composite
def scenes(draw):
    """Films of the sensor's proportions under a load of any kind."""
    random, kind = (
        np.random.default_rng(draw(st.integers(0, 2**32))),
        draw(st.sampled_from([*LOADS])),
    )
    return random_scene(random, **{**LOADS[kind], "numerics.observable": "material"})


@given(scene=scenes(), factor=st.floats(0.2, 5))
@few
def test_only_force_over_thickness_matters(scene, factor):
    """Same stresses, so the same charges and deflections, on the same mesh."""
    force_N, thickness_um = factor * scene.load.force_N, factor * scene.film.thickness_um
    thick = scene.with_(**{"load.force_N": force_N, "film.thickness_um": thickness_um})
    expected = solve(scene)
    assume(expected.status is not Status.UNSTABLE)  # a stuck punch can compress the film
    scaled = solve(thick, mesh=expected.mesh)
    assert scaled.charges_pC == pytest.approx(expected.charges_pC, rel=1e-7)
    assert scaled.deflection_max_mm == pytest.approx(expected.deflection_max_mm, rel=1e-7)


@given(scene=scenes())
@few
def test_rim_bears_the_force(scene):
    """A follower's resultant is not F, as the film under the probe is stretched and tilted."""
    solution = solve(scene)
    assume(solution.status is not Status.UNSTABLE)
    equilibrium, state = solution.fields.equilibrium, solution.fields.state
    applied = equilibrium.applied_force(state)[2]
    error = 0.1 if scene.load.kind == "follower" else 1e-12
    assert applied == pytest.approx(scene.load.force_N, rel=error)
    assert equilibrium.rim_reaction(state)[2] == pytest.approx(-applied, rel=1e-6)
    assert solution.force_balance < 1e-6


@pytest.mark.parametrize("kind", KINDS)
def test_stated_errors_cover_true_ones_in_drawn_scenes(kind):
    """Against ten times finer solves; charges whose parts cancel have a warning, and no tolerance
    of their own."""
    (scene,) = drawn_scenes(kind, 1, seed=5)
    solution, fine = (solve(scene.with_(**{"numerics.tolerance": t})) for t in (3e-3, 3e-4))
    exact, stated = values(fine.charges_pC), values(solution.charge_errors_pC)
    errors = np.abs(values(solution.charges_pC) - exact)
    told = errors > 2.0 * values(fine.charge_errors_pC)
    assert (stated > 0.2 * errors)[told].all()
    assert stated.max() < 10.0 * errors.max() + 3.0 * values(fine.charge_errors_pC).max()
    warned = " ".join(solution.warnings)
    plain = [f"charge {name}:" not in warned for name in fine.charges_pC]
    assert (errors <= 1.3 * 3e-3 * np.abs(exact))[plain].all()
