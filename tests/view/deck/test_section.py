"""Layers on the film as one sheet."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem import Scene
from pvdf_fem.film.laws.laminate import Laminate
from pvdf_fem.film.space import Space
from pvdf_fem.view.deck.section import EngineeringConstants, make_sections
from pvdf_fem.view.files.mesh_grid import MeshGrid
from tests.helpers.discs import uniform_mesh
from tests.validation.calculix import SCENES

LAYERED = SCENES["patches on an orthotropic film"]


@pytest.mark.parametrize("scene", [Scene(), LAYERED], ids=["plain", "layered"])
def test_a_section_has_the_membrane_forces_of_all_layers(scene):
    """The laminate of the solver adds the stresses of film and layers, the section has one."""
    mesh = uniform_mesh(scene, 5.0)
    laminate = Laminate(Space(mesh, 1), scene.film)
    strain = np.random.default_rng(1).normal(scale=1e-3, size=(mesh.nelements, 1, 3))
    expected = laminate.resultant(strain)[:, 0]
    film_stress = laminate.stress(strain)[:, 0]
    is_found = np.zeros(mesh.nelements, dtype=int)
    for section in make_sections(scene.film, MeshGrid.from_mesh(mesh, order=1)):
        elements = section.elements
        is_found[elements] += 1
        stress = (strain[elements, 0] + section.prestrain) @ section.stiffness
        np.testing.assert_allclose(stress, expected[elements], rtol=1e-10, atol=1e-3)
        of_film = section.compute_film_stress(stress, scene.film)
        np.testing.assert_allclose(of_film, film_stress[elements], rtol=1e-8, atol=1e-2)
    assert (is_found == 1).all()


def test_constants_are_those_of_the_scene():
    film = LAYERED.film
    constants = EngineeringConstants.from_stiffness(film.stiffness)
    found = [constants.E1, constants.E2, constants.nu12, constants.G12]
    assert found == pytest.approx([2.5e9, 1.8e9, film.poisson_ratio, 0.7e9])
    assert not constants.is_isotropic
    plain = EngineeringConstants.from_stiffness(Scene().film.stiffness)
    assert plain.is_isotropic
    assert (plain.E1, plain.nu12) == pytest.approx((2e9, 0.34))
