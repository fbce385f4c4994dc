"""Responses to a sphere, whose force decides the area of contact."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem import Scene, build_response, locate
from pvdf_fem.progress import Work
from pvdf_fem.response.build import ResponseOptions, options_for
from pvdf_fem.response.held_out import HeldOut, random_touches, solves_of
from pvdf_fem.solvers.status import Status

SPHERE = Scene(probe={"shape": "sphere", "radius_mm": 5.0}, load={"kind": "contact"})
OPTIONS = ResponseOptions(error=1e-2, held_out=4, attempts=1)


@pytest.fixture(scope="module")
def built():
    return build_response(SPHERE, 4.0, (0.4, 1.2), 1e-2, 1, options=OPTIONS)


def test_a_response_is_true_to_the_solver_and_locates(built):
    """Though the contact grows with the force, and elements along its edge with it."""
    assert (built.status, built.remarks) == (Status.CONVERGED, ())
    touches = random_touches(built.domain, 3, seed=9)
    solved = HeldOut.of(touches, [*Work(1).run(solves_of(SPHERE, touches, 5e-4, share=1.0))])
    errors, _ = solved.relative_errors(SPHERE.film, built.evaluate(touches)[0])
    assert errors.max() < built.error_bound < 1e-2
    charges = solved.forces @ [SPHERE.film.d31_pC_N, SPHERE.film.d32_pC_N]
    for (x, y, _, force), row in zip(touches, charges, strict=True):
        location = locate(built, dict(zip(built.names, row.tolist(), strict=True)))
        assert "rotation_deg" not in location.unknown
        assert (location.best.x_mm, location.best.y_mm) == pytest.approx((x, y), abs=0.03)
        assert location.best.force_N == pytest.approx(force, rel=3e-3)


def test_charges_turn_with_the_touch(built):
    """The four electrodes are images of each other in quarter turns, the places of the rim not."""
    x, y, rotation, force = random_touches(built.domain, 20, seed=4).T
    charges, _ = built.evaluate(np.stack([x, y, rotation, force], axis=-1))
    turned, _ = built.evaluate(np.stack([-y, x, rotation + 70.0, force], axis=-1))
    assert turned[:, [1, 2, 3, 0]] == pytest.approx(charges, rel=built.error_bound)


@pytest.mark.slow
@pytest.mark.parametrize(("film_mm", "force_N"), [(20.0, (0.1, 1.0)), (45.0, (0.1, 5.0))])
def test_a_tip_meets_its_tolerance_at_once(film_mm, force_N):
    """Films of two sizes, of which a first attempt at the tolerance itself missed the bound."""
    scene = SPHERE.with_(**{"film.radius_mm": film_mm, "probe.radius_mm": 6.0})
    assert options_for(scene, 1e-2).error < 1e-2
    told = []
    made = build_response(
        scene, None, force_N, 1e-2, 1, progress=lambda done, total: told.append(total)
    )
    assert made.error_bound <= 1e-2
    assert told[0] / 1.5 < told[-1] < 1.5 * told[0]
