"""What a film cannot be: each combination without a model is refused by the key to change."""

from __future__ import annotations

import re

import pytest

from pvdf_fem import build_response, gradients, respond
from pvdf_fem.response.response_file import mechanics_of
from pvdf_fem.sweeps.equivalence import mechanics
from pvdf_fem.sweeps.plan import plan
from tests.helpers.discs import TRIANGLE
from tests.helpers.refusals import refused

PLACE = {"x_mm": 10.0, "y_mm": 0.0}
TAPE = {"side_mm": 3.0, "thickness_um": 50.0, "youngs_modulus_GPa": 3.0, **PLACE}
BEFORE = {**TAPE, "bonded": "before stretching"}
TAPED, WARM = {"film.patches": [TAPE]}, {"probe.temperature_K": 10.0}
D33, WIRED = {"film.d33_pC_N": -15.0}, {"film.coupling": True, "readout.kind": "voltage"}
WRINKLES, EDGES = {"film.compression": "tension-field"}, {"numerics.observable": "thesis-edge"}
RUBBER = {"film.law": "neo-hookean"}
SPHERE = {"probe.shape": "sphere", "probe.radius_mm": 5.0, "load.kind": "contact"}
PRESSURE, WEIGHT = {"film.pressure_Pa": 5.0}, {"film.gravity_m_s2": 5.0}


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({**WIRED, **WRINKLES}, "film.compression"),
        ({**WIRED, **EDGES}, "numerics.observable"),
        ({**WIRED, **WARM}, "film.coupling"),
        ({**WIRED, "film.warming_K": 1.0}, "film.coupling"),
        ({**WIRED, "film.rim_displacement_um": [1.0]}, "film.coupling"),
        ({**WIRED, "film.patches": [BEFORE]}, "film.coupling"),
        ({**WIRED, "film.d31_pC_N": 200.0, "film.permittivity": 1.0}, "film.coupling"),
        ({"film.coupling": "yes"}, "film.coupling"),
        ({"film.bending": "yes"}, "film.bending"),
        ({**D33, **TAPED}, "film.d33_pC_N"),
        ({**RUBBER, "film.youngs_modulus_GPa": [1.0, 2.0]}, "film.law"),
        ({**RUBBER, "film.shear_modulus_GPa": 1.0}, "film.law"),
        ({**RUBBER, **WRINKLES}, "film.compression"),
        ({**RUBBER, "film.bending": "auto"}, "film.bending"),
        ({**RUBBER, **WIRED}, "film.coupling"),
        ({**TAPED, "film.bending": "auto"}, "film.bending"),
        ({**TAPED, **WRINKLES}, "film.compression"),
        ({"film.patches": [{**TAPE, "x_mm": 60.0}]}, "film.patches"),
        ({"film.patches": [{**TAPE, "youngs_modulus_GPa": -1.0}]}, "film.patches[0].youngs"),
        ({"film.patches": [{**TAPE, "side_m": 3.0}]}, "film.patches[0].side_m"),
        ({"film.patches": [{**TAPE, "edge_radius_mm": 1.0}]}, "film.patches[0].edge_radius_mm"),
        ({"film.patches": [{**TAPE, "thermal_expansion_per_K": 1e-5}]}, "film.patches[0].therm"),
        ({**WARM, "probe.contact_time_s": 0.0}, "probe.contact_time_s"),
        ({**WARM, **WRINKLES}, "film.compression"),
        ({**WARM, **EDGES}, "numerics.observable"),
        ({**WARM, **SPHERE}, "load.kind"),
        ({"electrodes[0].temperature_K": 1.0}, "electrodes"),
        ({"film.rim_displacement_um": [0.0, 1.0]}, "film.rim_displacement_um"),
        ({"film.pressure_follows": True}, "film.pressure_follows"),
        ({**SPHERE, **PRESSURE}, "load.kind"),
    ],
)
def test_combinations_without_a_model_are_refused(changes, key):
    assert any(text.startswith(key) for text in refused(TRIANGLE.with_, **changes))


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
