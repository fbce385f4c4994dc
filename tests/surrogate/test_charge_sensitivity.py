"""Derivatives of the charges of a response with respect to parameters of the film."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pvdf_fem import Scene, build_response
from pvdf_fem.surrogate.charge_sensitivity import (
    require_derivatives,
    solve_slopes,
    solve_unloaded_film,
)
from pvdf_fem.surrogate.response import Response
from pvdf_fem.surrogate.touch_domain import draw_touches

KEYS = (
    "film.pretension_N_m",
    "film.youngs_modulus_GPa",
    "film.thickness_um",
    "film.poisson_ratio",
    "film.d31_pC_N",
)
#: Maximum rms error of the derivatives at other touches, as a fraction of their rms.
ERRORS = {"film.pretension_N_m": 0.15, "film.poisson_ratio": 0.2, "film.d31_pC_N": 0.15}
SCENE = Scene.parse('[probe]\nshape = "triangle"\nside_mm = 7.0\n').with_(
    **{
        "film.pretension_N_m": 8.0,
        "calibration": {"keys": [*KEYS, "stage.x_mm"], "deviations": [0.1] * (1 + len(KEYS))},
    }
)


@pytest.fixture(scope="module")
def response():
    """A coarse response; its scene has a calibration, so that it has derivatives."""
    return build_response(SCENE, 8.0, (0.2, 2.0), tolerance=1e-2, processes=1)


@pytest.mark.slow
def test_fitted_derivatives_are_those_of_solves_at_other_touches(response):
    touches = draw_touches(response.domain, 12, seed=7)
    charges_pC, slopes = response.evaluate(touches)
    found = response.sensitivities.evaluate(touches, charges_pC, slopes)
    unloaded = solve_unloaded_film(SCENE, KEYS)
    assert response.sensitivities.unloaded_slopes == pytest.approx(unloaded[:, 1:])
    solved = np.stack([solve_slopes(SCENE, touch, KEYS) for touch in touches])
    expected = solved - unloaded[:, 1:]
    sizes = np.abs(charges_pC - unloaded[:, 0]).max(axis=1)[:, None, None]
    errors = np.sqrt(np.square((found - expected) / sizes).mean(axis=(0, 1)))
    scale = np.sqrt(np.square(expected / sizes).mean(axis=(0, 1)))
    for key, error in zip(KEYS, errors / scale, strict=True):
        assert error < ERRORS.get(key, 0.03), key


@pytest.mark.slow
def test_derivatives_are_stored_with_the_response(response, tmp_path):
    """They are for its charges, and are solved again only for other keys."""
    path = tmp_path / "sensor.response"
    response.save(path)
    loaded = Response.load(path)
    np.testing.assert_array_equal(
        loaded.sensitivities.coefficients, response.sensitivities.coefficients
    )
    assert loaded.with_sensitivities() is loaded
    fewer = {"keys": [KEYS[1]], "deviations": [0.1], "correlations": None}
    other = loaded.for_scene(SCENE.with_(calibration=fewer))
    assert other.with_sensitivities() is other
    selected = loaded.sensitivities.select([KEYS[1]])
    np.testing.assert_array_equal(
        selected.coefficients[:, :, 0], loaded.sensitivities.coefficients[:, :, 1]
    )
    more_sensitive = SCENE.with_(**{"film.d31_pC_N": 9.0})
    assert loaded.for_scene(more_sensitive, check=False).sensitivities is None
    without = replace(loaded, sensitivities=None)
    assert without.with_sensitivities(processes=1).sensitivities.keys == KEYS


def test_keys_without_a_derivative_are_refused():
    """A film that bends has derivatives with respect to d31 and d32 only."""
    bending = SCENE.with_(**{"film.bending": True})
    with pytest.raises(ValueError, match=r"^calibration\.keys = film\.pretension_N_m: ") as error:
        require_derivatives(bending, KEYS)
    assert len(str(error.value).splitlines()) == 4
