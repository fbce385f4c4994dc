"""Loads on the whole film, with and without a probe: solvers, balance and flatness ask every term.
"""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem import Scene
from pvdf_fem.arrays import Array
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.term import State
from pvdf_fem.solvers.ladder import equilibrate
from pvdf_fem.solvers.status import Status
from tests.helpers.discs import graded_mesh

TIGHT = Scene().with_(**{"film.pretension_N_m": 1e3})
DISC = {"shape": "circle", "radius_mm": 4.0, "x_mm": 12.0, "y_mm": 3.0}
LIGHT = {"load.force_N": 1e-3}


def weighed(scene: Scene, gravity: float = -9.81) -> Equilibrium:
    """The equations of a scene whose film has a weight."""
    heavy = scene.with_(**{"film.gravity_m_s2": gravity})
    return Equilibrium(heavy, graded_mesh(heavy, 3.0, 8.0), 2)


def found(equilibrium: Equilibrium) -> tuple[Array, State]:
    """Deflections (nodes,) in m, and the state, of an equilibrium that converges."""
    result = equilibrate(equilibrium)
    assert result.converged
    return equilibrium.dofs(result.q)[2::3], equilibrium.state(result.q)


@pytest.mark.parametrize("gravity", [-9.81, 9.81e2])
def test_a_taut_film_sags_under_its_weight_as_a_linear_membrane(gravity):
    """w(r) = q (a² - r²)/(4 N0)."""
    equilibrium = weighed(TIGHT, gravity)
    w, state = found(equilibrium)
    q, a = 1760.0 * 25e-6 * gravity, 45e-3
    r = np.hypot(*equilibrium.space.basis.doflocs)
    assert w == pytest.approx(q * (a**2 - r**2) / 4e3, abs=1e-4 * abs(q) * a**2 / 4e3)
    assert equilibrium.force == pytest.approx(abs(q) * np.pi * a**2)
    total = equilibrium.rim_reaction(state) + equilibrium.applied_force(state)
    assert np.abs(total).max() < 1e-9 * equilibrium.force


@pytest.mark.parametrize("kind", ["dead", "follower", "rigid"])
def test_a_probe_beside_it_adds_its_own_deflection(kind):
    scene = TIGHT.with_(probe=DISC, **LIGHT, **{"load.kind": kind})
    both = weighed(scene, 9.81e2)
    membrane, press, weight = both.terms
    alone = both.with_terms([membrane, press])
    unloaded = both.with_terms([membrane, press.with_force(0.0), weight])
    deflections = [found(equations)[0] for equations in (both, alone, unloaded)]
    assert np.ptp(deflections[2]) > 0.05 * np.ptp(deflections[0])
    largest = np.abs(deflections[0]).max()
    assert deflections[0] == pytest.approx(deflections[1] + deflections[2], abs=1e-5 * largest)


@pytest.mark.parametrize(
    "changes",
    [
        {"film.temperature_change_K": 0.0},
        {"film.temperature_change_K": 0.5, "film.compression": "tension-field"},
    ],
)
def test_a_slack_film_bears_its_weight(changes):
    equilibrium = weighed(Scene().with_(**changes), -9.81)
    w, state = found(equilibrium)
    assert w.min() < -1e-4
    assert equilibrium.imbalance(state) < 1e-4 * equilibrium.force


def test_a_film_is_flat_where_nothing_moves_it():
    tight, weight = weighed(TIGHT, 0.0), weighed(TIGHT, 1e-12)
    assert tight.is_flat
    assert not weight.is_flat
    pressed = Scene().with_(probe=DISC, **LIGHT)
    assert not Equilibrium(pressed, graded_mesh(pressed, 4.0, 12.0), 1).is_flat


PATCH = {"shape": "circle", "x_mm": 20.0, "y_mm": 0.0, "radius_mm": 8.0, "thickness_um": 10.0}


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("film.rim_displacement_um", [0.0, 0.0, 0.0, 1.0, 0.0]),
        ("film.patches", [{**PATCH, "bonded": "before stretching"}]),
    ],
)
def test_a_film_of_uneven_stress_moves_without_a_load(key, value):
    scene = Scene().with_(**{key: value})
    equilibrium = Equilibrium(scene, graded_mesh(scene, 4.0, 12.0), 2)
    assert not equilibrium.is_flat
    result = equilibrate(equilibrium)
    assert result.converged
    residual = equilibrium.residual(equilibrium.state(result.q))
    assert np.abs(residual).max() < 1e-6 * np.abs(equilibrium.flat_forces).max()
    assert result.q.any()


def test_a_rim_that_moves_inwards_makes_a_flat_film_unstable():
    scene = Scene().with_(**{"film.rim_displacement_um": [-10.0]})
    equilibrium = Equilibrium(scene, graded_mesh(scene, 4.0, 12.0), 2)
    assert equilibrium.is_flat
    assert equilibrate(equilibrium).status is Status.UNSTABLE
