"""The table ``[calibration]``: its covariance, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem import Scene, SceneError

TABLE = """
[film]
pretension_N_m = 8.0
[calibration]
keys = ["film.pretension_N_m", "readout.gain.A", "stage.x_mm"]
deviations = [0.3, 0.01, 0.2]
correlations = [[1, 0.5, 0], [0.5, 1, -0.1], [0, -0.1, 1]]
date = "2026-11-28"
"""


def test_the_covariance_has_the_deviations_and_correlations():
    scene = Scene.parse(TABLE)
    table = scene.calibration
    expected = [[0.09, 0.0015, 0.0], [0.0015, 1e-4, -2e-4], [0.0, -2e-4, 0.04]]
    assert table.covariance == pytest.approx(np.array(expected))
    again = Scene.parse(scene.to_toml())
    assert (again, hash(again)) == (scene, hash(scene))
    diagonal = scene.with_(calibration={"correlations": None}).calibration
    assert diagonal.covariance == pytest.approx(np.diag([0.09, 1e-4, 0.04]))


@pytest.mark.parametrize(
    "key",
    [
        "film.thickness_um",
        "film.temperature_change_K",
        "film.d31_pC_N",
        "readout.gain.D",
        "readout.offset_V.B",
        "stage.rotation_deg",
    ],
)
def test_numbers_that_calibrations_fit_are_keys(key):
    """Without a readout or a stage, they are those of the defaults."""
    assert Scene(calibration={"keys": [key], "deviations": [0.1]}).calibration.keys == (key,)


def make_table(keys, deviations, **others):
    return {"keys": list(keys), "deviations": deviations, **others}


GAINS = ("readout.gain.A", "readout.gain.B")


@pytest.mark.parametrize(
    ("table", "key"),
    [
        (make_table(["film.pretension_N_m"], [1.0]), "calibration.keys"),  # it is cooled instead
        (make_table(["film.youngs_modulus_GPa.1"], [1.0]), "calibration.keys"),  # one modulus
        (make_table(["film.radius_mm"], [1.0]), "calibration.keys"),
        (make_table(["readout.gain.E"], [1.0]), "calibration.keys"),
        (make_table(["gain.A"], [1.0]), "calibration.keys"),
        (make_table(["load.force_N"], [1.0]), "calibration.keys"),
        (make_table(["readout.gain.A"] * 2, [1.0, 1.0]), "calibration.keys"),
        (make_table(GAINS, [1.0]), "calibration.deviations"),
        (make_table(GAINS, [1.0, -1.0]), "calibration.deviations"),
        (make_table(GAINS, [1.0, np.inf]), "calibration.deviations[1]"),
        (make_table(GAINS, [1, 1], correlations=[[1, 2], [2, 1]]), "calibration.correlations"),
        (make_table(GAINS, [1, 1], correlations=[[1, 0.2], [0.1, 1]]), "calibration.correlations"),
        (make_table(GAINS, [1, 1], correlations=[[2, 0], [0, 1]]), "calibration.correlations"),
        (make_table(GAINS, [1, 1], correlations=[[1, 0]]), "calibration.correlations"),
        ({"covariance": [[1.0]]}, "calibration.covariance"),
    ],
)
def test_what_cannot_be_a_calibration_is_refused_by_key(table, key):
    with pytest.raises(SceneError) as error:
        Scene(calibration=table)
    assert [problem.partition(" =")[0].partition(":")[0] for problem in error.value.problems] == [
        key
    ]
