"""What serves fewer films than `solve` refuses the others; `tests/scene/` has pairs of effects."""

from __future__ import annotations

import re

import pytest

from pvdf_fem import build_response, gradients, respond
from pvdf_fem.response.response_file import mechanics_of
from pvdf_fem.sweeps.equivalence import mechanics
from pvdf_fem.sweeps.plan import plan
from tests.helpers.discs import TRIANGLE

TAPE = {"side_mm": 3.0, "thickness_um": 50.0, "x_mm": 10.0, "y_mm": 0.0}
TAPED, WARM = {"film.patches": [TAPE]}, {"probe.temperature_K": 10.0}
D33, WIRED = {"film.d33_pC_N": -15.0}, {"film.coupling": True, "readout.kind": "voltage"}
PRESSURE, WEIGHT = {"film.pressure_Pa": 5.0}, {"film.gravity_m_s2": 5.0}


@pytest.mark.parametrize(
    ("refuses", "changes", "key"),
    [
        (build_response, TAPED, "film: patches"),
        *((serves, WARM, "probe.temperature_K") for serves in (build_response, mechanics)),
        (build_response, PRESSURE, "film.pressure_Pa"),
        (build_response, WEIGHT, "film.gravity_m_s2"),
        (mechanics_of, WIRED, "film.coupling"),
        (lambda scene: respond(scene, 20.0), WIRED, "film.coupling"),
        (lambda scene: respond(scene, 20.0), D33, "film.d33_pC_N"),
        (lambda scene: plan([scene]), D33, "film.d33_pC_N"),
        *((serves, D33, "film.d33_pC_N") for serves in (mechanics_of, gradients)),
    ],
)
def test_what_serves_fewer_films_refuses_the_others(refuses, changes, key):
    with pytest.raises(ValueError, match=re.escape(key)):
        refuses(TRIANGLE.with_(**changes))
