"""What is no result, and what is one with a warning: with values, places and areas."""

from __future__ import annotations

import re

import numpy as np
import pytest

from pvdf_fem import solve
from pvdf_fem.charges.forces import Forces
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.reference.axisymmetric import axisymmetric_membrane
from pvdf_fem.reference.axisymmetric_wrinkled import wrinkled_membrane
from pvdf_fem.solution import admissible
from pvdf_fem.solution.fields import Fields
from pvdf_fem.solvers.newton import factorise
from pvdf_fem.solvers.status import Status
from tests.helpers.discs import RECTANGLE, TRIANGLE, free_disc, graded_mesh
from tests.helpers.solvers import newton_result

NO_FORCES = Forces(np.zeros((0, 2)), np.zeros((0, 2)))


@pytest.fixture(scope="module")
def solved():
    problem = Equilibrium(TRIANGLE, graded_mesh(TRIANGLE, 2.5, 12.0))
    return problem, newton_result(problem)


def test_a_solution_is_admitted(solved):
    problem, result = solved
    assert admissible.refusal(Fields(problem, result.q, NO_FORCES), result.factors) is None


def test_forces_must_balance(solved):
    problem, result = solved
    off = Fields(problem, result.q * (1 + 1e-5), NO_FORCES)
    assert admissible.refusal(off, result.factors) is Status.UNBALANCED
    none = Fields(problem, result.q * np.nan, NO_FORCES)
    assert admissible.refusal(none, result.factors) is Status.UNBALANCED


def test_a_compressed_solution_must_be_a_minimum(solved, monkeypatch):
    problem, result = solved
    hot = Equilibrium(
        TRIANGLE.with_(**{"film.temperature_change_K": 10.0}), problem.membrane.space.mesh
    )
    flat = factorise(hot.tangent(hot.state(0.0 * result.q)))
    fields = Fields(problem, result.q, NO_FORCES)
    assert admissible.refusal(fields, flat) is None
    monkeypatch.setattr(admissible, "compressed", lambda state: True)
    assert admissible.refusal(fields, flat) is Status.UNSTABLE


@pytest.mark.parametrize("scene", [RECTANGLE, TRIANGLE])
@pytest.mark.parametrize("force_N", [0.25, 1.0, 7.5])
def test_no_warning_in_the_thesis(scene, force_N):
    changes = {"load.force_N": force_N, "load.kind": "follower"}
    assert not solve(scene.with_(**changes)).warnings


def number_after(text, warnings):
    [warning] = [warning for warning in warnings if re.search(text, warning)]
    found = re.search(text + r" ([0-9.e+-]+)", warning)
    assert found
    return float(found[1]), warning


def test_values_and_places_are_those_of_the_axisymmetric_film():
    force, patch = 0.1, 0.2
    reference = axisymmetric_membrane(force, poisson_ratio=0.34, patch_radius=patch)
    warnings = solve(free_disc(force, poisson_ratio=0.34, patch_radius=patch)).warnings
    radii = np.linspace(0.0, 1.0, 2001)
    slope, text = number_after("slope: up to", warnings)
    assert slope == pytest.approx(np.abs(reference.slope(radii)).max(), rel=0.02)
    place = re.search(r"\((\S+), (\S+)\) mm", text)
    assert place
    assert np.hypot(float(place[1]), float(place[2])) == pytest.approx(50 * patch, rel=0.05)
    stress, _ = number_after("principal stress up to", warnings)
    assert 1e6 * stress == pytest.approx(2e9 * reference.radial_tension(0.0), rel=0.02)
    strain, _ = number_after("strain: up to", warnings)
    stretch = reference.radial_stretch(radii)
    strains = stretch + 0.5 * (stretch**2 + reference.slope(radii) ** 2)
    assert strain == pytest.approx(strains.max(), rel=0.02)


def test_wrinkled_area_is_that_of_the_axisymmetric_film():
    force, strain, patch = 4.444e-4, 1.1e-3, 0.2
    reference = wrinkled_membrane(
        force, poisson_ratio=0.34, patch_radius=patch, thermal_strain=strain
    )
    radii = np.linspace(0.01, 1.0, 2000)
    wrinkled = 1.0 - radii[reference.hoop_tension(radii) <= 0.0][0] ** 2
    scene = free_disc(
        force,
        poisson_ratio=0.34,
        patch_radius=patch,
        **{"film.temperature_change_K": 1e3 * strain, "film.compression": "tension-field"},
    )
    [warning] = solve(scene).warnings
    found = re.search(r"wrinkled on .*\(([0-9.]+)%", warning)
    assert found
    assert float(found[1]) / 100 == pytest.approx(wrinkled, abs=0.02)


def test_compression_is_warned_of():
    near_rim = RECTANGLE.with_(
        **{
            "film.temperature_change_K": 0.0,
            "probe.shape": "circle",
            "probe.radius_mm": 5.0,
            "probe.x_mm": 30.0,
            "numerics.tolerance": 1e-2,
        }
    )
    result = solve(near_rim)
    if result.status is Status.CONVERGED:
        area, _ = number_after(r"compression: down to \S+ MPa on", result.warnings)
        assert 0.0 < area < 6362.0
    else:
        assert result.status is Status.UNSTABLE
