"""Responses to a sphere, whose force decides the area of contact."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem import Response, Scene, build_response, locate
from pvdf_fem.progress import Work
from pvdf_fem.response.build import ResponseOptions
from pvdf_fem.response.held_out import HeldOut, random_touches, solves_of
from pvdf_fem.solvers.status import Status

SPHERE = Scene(probe={"shape": "sphere", "radius_mm": 5.0}, load={"kind": "contact"})
OPTIONS = ResponseOptions(error=1e-2, held_out=4, attempts=1)
DOMAIN = {"reach_mm": 4.0, "force_N": (0.4, 1.2)}


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """A small response, as its file has it."""
    path = tmp_path_factory.mktemp("built") / "sphere.response"
    made = build_response(SPHERE, tolerance=1e-2, file=path, processes=1, options=OPTIONS, **DOMAIN)
    read = Response.load(path)
    touches = random_touches(made.domain, 5, seed=2)
    assert np.array_equal(read.evaluate(touches)[0], made.evaluate(touches)[0])
    return read


@pytest.fixture(scope="module")
def solved(built):
    """Full solves of touches that the build has not seen."""
    touches = random_touches(built.domain, 3, seed=9)
    return HeldOut.of(touches, [*Work(1).run(solves_of(SPHERE, touches, 5e-4, share=1.0))])


@pytest.mark.slow
def test_a_response_is_true_to_the_solver(built, solved):
    """Though the contact grows with the force, and elements along its edge with it."""
    assert (built.status, built.remarks) == (Status.CONVERGED, ())
    errors, _ = solved.relative_errors(SPHERE.film, built.evaluate(solved.touches)[0])
    assert errors.max() < built.error_bound < 1e-2


def test_charges_turn_with_the_touch(built):
    """The four electrodes are images of each other in quarter turns, the places of the rim not."""
    x, y, rotation, force = random_touches(built.domain, 20, seed=4).T
    charges, _ = built.evaluate(np.stack([x, y, rotation, force], axis=-1))
    turned, _ = built.evaluate(np.stack([-y, x, rotation + 70.0, force], axis=-1))
    places = np.array([electrode.outline.centroid for electrode in SPHERE.electrode_list])
    apart = np.linalg.norm(places[:, None] @ [[0, 1], [-1, 0]] - places, axis=-1)
    assert turned[:, apart.argmin(axis=1)] == pytest.approx(charges, rel=built.error_bound)


def test_touches_are_located(built, solved):
    """From the charges of full solves, without a rotation."""
    charges = solved.forces @ [SPHERE.film.d31_pC_N, SPHERE.film.d32_pC_N]
    for (x, y, _, force), row in zip(solved.touches, charges, strict=True):
        location = locate(built, dict(zip(built.names, row.tolist(), strict=True)))
        assert "rotation_deg" not in location.unknown
        assert (location.best.x_mm, location.best.y_mm) == pytest.approx((x, y), abs=0.03)
        assert location.best.force_N == pytest.approx(force, rel=3e-3)
