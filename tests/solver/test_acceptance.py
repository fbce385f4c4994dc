"""Solutions that are rejected, and warnings with values, places and areas."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from pvdf_fem import solve
from pvdf_fem.electrodes.stress_integrals import StressIntegrals
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.problem.problem import Problem
from pvdf_fem.solver import acceptance
from pvdf_fem.solver.adaptive import solve_outputs
from pvdf_fem.solver.discrete_solution import DiscreteSolution
from pvdf_fem.solver.nonlinear.factors import count_negative_pivots, factorise
from pvdf_fem.solver.nonlinear.status import Status
from reports.reference.axisymmetric import axisymmetric_membrane
from reports.reference.axisymmetric_wrinkled import wrinkled_membrane
from tests.helpers.discs import LOADS, RECTANGLE, TRIANGLE, free_disc, graded_mesh, values
from tests.helpers.solvers import solve_by_newton

NO_INTEGRALS = StressIntegrals(np.zeros((0, 2)), np.zeros((0, 2)))
#: Under this probe a film without pretension is in compression.
NEAR_RIM = {
    "film.temperature_change_K": 0.0,
    "probe": {"shape": "circle", "radius_mm": 5.0, "x_mm": 36.0},
    "numerics.tolerance": 1e-2,
}


@pytest.fixture(scope="module")
def solved():
    problem = Equilibrium(Problem.from_scene(TRIANGLE), graded_mesh(TRIANGLE, 2.5, 12.0))
    return problem, solve_by_newton(problem)


@pytest.mark.parametrize(
    ("factor", "change", "status"),
    [
        (1.0, None, None),
        (1.0, 0.09, None),
        (1.0, 0.11, Status.UNSTABLE),
        (1.0 + 1e-5, None, Status.UNBALANCED),
        (np.nan, None, Status.UNBALANCED),
    ],
)
def test_rejects_unbalanced_forces_and_large_changes_by_wrinkles(solved, factor, change, status):
    problem, result = solved
    fields = DiscreteSolution(problem, factor * result.q, NO_INTEGRALS)
    assert acceptance.find_rejection_status(fields, result.factors, change) is status


def test_rejects_a_following_pressure_beyond_its_limit_load():
    """Beyond a limit load the number of negative pivots is odd, although the forces balance."""
    scene = TRIANGLE.with_(**LOADS["follower"])
    problem = Equilibrium(Problem.from_scene(scene), graded_mesh(scene, 6.0, 14.0))
    result = solve_by_newton(problem)
    fields = DiscreteSolution(problem, result.q, NO_INTEGRALS)
    assert acceptance.find_rejection_status(fields, result.factors, None) is None
    tangent = problem.tangent(fields.solved_state).tolil()
    tangent[0, 0] *= -1.0
    beyond = factorise(tangent.tocsc())
    assert count_negative_pivots(beyond) == 1
    assert acceptance.find_rejection_status(fields, beyond, None) is Status.UNSTABLE


def test_rejects_a_buckled_plate():
    """The clamped disc buckles at 14.68 D/a^2, which 2.56 mK make in a film of 25 um."""
    for change_K, status in ((2.2e-3, None), (3e-3, Status.UNSTABLE)):
        changes = {"film.temperature_change_K": change_K, "load.force_N": 0.0}
        scene = TRIANGLE.with_(**changes, **{"film.bending": True})
        film = Equilibrium(Problem.from_scene(scene), graded_mesh(scene, 6.0, 12.0))
        flat = DiscreteSolution(film, np.zeros(film.unknowns.count), NO_INTEGRALS)
        factors = factorise(film.tangent(flat.solved_state))
        assert (count_negative_pivots(factors) > 0) == (status is not None)
        assert acceptance.find_rejection_status(flat, factors, None) is status


@pytest.mark.parametrize("scene", [RECTANGLE, TRIANGLE])
def test_scenes_of_the_thesis_have_no_warning(scene):
    assert not solve(scene.with_(**LOADS["follower"], **{"load.force_N": 7.5})).warnings


def number_after(text, warnings):
    [warning] = [warning for warning in warnings if re.search(text, warning)]
    match = re.search(text + r" ([0-9.e+-]+)", warning)
    assert match
    return float(match[1]), warning


def test_values_and_places_in_warnings_agree_with_the_axisymmetric_film():
    force = 0.1
    patch = 0.2
    reference = axisymmetric_membrane(force, poisson_ratio=0.34, patch_radius=patch)
    warnings = solve(free_disc(force, poisson_ratio=0.34, patch_radius=patch)).warnings
    radii = np.linspace(0.0, 1.0, 2001)
    slope, text = number_after("slope: up to", warnings)
    assert slope == pytest.approx(np.abs(reference.slope(radii)).max(), rel=0.02)
    place = re.search(r"\((\S+), (\S+)\) mm", text)
    assert np.hypot(float(place[1]), float(place[2])) == pytest.approx(50 * patch, rel=0.05)
    stress, _ = number_after("principal stress up to", warnings)
    assert 1e6 * stress == pytest.approx(2e9 * reference.radial_tension(0.0), rel=0.02)
    strain, _ = number_after("strain: up to", warnings)
    stretch = reference.radial_stretch(radii)
    strains = stretch + 0.5 * (stretch**2 + reference.slope(radii) ** 2)
    assert strain == pytest.approx(strains.max(), rel=0.02)


def test_wrinkled_area_agrees_with_the_axisymmetric_film():
    strain = 1.1e-3
    shape = {"poisson_ratio": 0.34, "patch_radius": 0.2}
    reference = wrinkled_membrane(4.444e-4, **shape, thermal_strain=strain)
    radii = np.linspace(0.01, 1.0, 2000)
    wrinkled = 1.0 - radii[reference.hoop_tension(radii) <= 0.0][0] ** 2
    heated = {"film.temperature_change_K": 1e3 * strain, "film.compression": "tension-field"}
    heated |= {"numerics.tolerance": 1e-2}
    [warning] = solve(free_disc(4.444e-4, **shape, **heated)).warnings
    share = re.search(r"wrinkled on .*\(([0-9.]+)%", warning)
    assert float(share[1]) / 100 == pytest.approx(wrinkled, abs=0.02)


@pytest.mark.parametrize(
    ("modulus", "tolerance", "bending"),
    [(2.0, 0.3, "auto"), (2.0, 1e-3, False), ([3.0, 1.2], 3e-4, False)],
)
def test_warning_states_the_change_by_wrinkles(modulus, tolerance, bending):
    near_rim = RECTANGLE.with_(
        **NEAR_RIM
        | {
            "film.youngs_modulus_GPa": modulus,
            "load.force_N": 1.0 if bending else 2e-6,
            "film.bending": bending,
            "numerics.tolerance": tolerance,
        }
    )
    solution = solve(near_rim)
    wrinkling = {"film.bending": False, "film.compression": "tension-field"}
    wrinkled = solve(near_rim.with_(**wrinkling)).charges_pC
    area, warning = number_after(r"compression: down to \S+ MPa on", solution.warnings)
    assert 0.0 < area < 6362.0
    for name, error in solution.charge_errors_pC.items():
        change = abs(solution.charges_pC[name] - wrinkled[name])
        assert change < 1.5 * error + tolerance * abs(wrinkled[name])
    stated, _ = number_after("change a charge by up to", [warning])
    assert 1e-3 < stated < 1e-2
    assert ("wrinkles would change" in solution.reason) == (stated > tolerance)


def test_a_scene_of_a_sweep_may_be_in_compression():
    """It has no electrodes of its own, since its mesh follows none."""
    near_rim = RECTANGLE.with_(**NEAR_RIM)
    without = near_rim.model_copy(update={"electrodes": ()})
    outputs = [replace(output, patch=None) for output in Problem.from_scene(near_rim).outputs]
    solution = solve_outputs(Problem.from_scene(without, outputs=outputs))
    errors = solution.discrete.stress_integrals.charge_errors([8.0, 8.0])
    assert errors == pytest.approx(values(solve(near_rim).charge_errors_pC), rel=0.1)


SLACK = {"film.temperature_change_K": 5.0, "load.force_N": 0.0}


@pytest.mark.parametrize("changes", [{"film.bending": True}, SLACK])
def test_no_change_by_wrinkles_of_a_film_that_bends_or_has_no_result(changes):
    warnings = solve(RECTANGLE.with_(**NEAR_RIM | changes)).warnings
    [warning] = [text for text in warnings if text.startswith("compression")]
    assert "change a charge" not in warning


def test_warns_of_a_charge_whose_parts_cancel():
    """Stress integrals of 1 N and of 0.999 N, with coefficients of opposite signs."""
    scene = TRIANGLE.with_(**{"film.d31_pC_N": 20.0, "film.d32_pC_N": -20.0})
    integrals = np.array([[1.0, 0.999], [1.0, 0.5], [2.0, 1.0], [1.0, 0.5]])
    uncertain = StressIntegrals(integrals, 1e-4 * integrals * [1.0, 0.5])
    [warning] = acceptance.list_cancellation_warnings(scene, uncertain)
    assert re.findall(r"-?\d[\d.]*", warning)[:3] == ["0.02", "20", "-19.98"]
    accurate = StressIntegrals(integrals, 1e-8 * integrals)
    assert not acceptance.list_cancellation_warnings(scene, accurate)
