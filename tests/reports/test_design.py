"""The design study: information and symmetry, Jacobians against finer differences, the page."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pvdf_fem import solve
from reports import design
from reports.common.results import Results
from reports.design_study.choice import Alternative, choose
from reports.design_study.resolution import Linearisation, Noise, PolarMap
from reports.design_study.sensor import PROBE_RADIUS_MM, Lattice, Sensor, is_even
from reports.design_study.study import THESIS, Axes, Study, drawn, quantile, rings
from tests.reports.test_page import assert_links_work

LATTICE = Lattice(reach_mm=9.0)
PLACES = np.array([[5.0, 1.0], [1.0, 5.0], [-5.0, 1.0], [-1.0, -5.0], [3.0, 7.0], [7.0, 3.0]])


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    solved_study = Study(Results(tmp_path_factory.mktemp("results"), 1), LATTICE)
    solved_study.solve([THESIS, drawn(THESIS)])
    return solved_study


def made_up(seed: int = 1, electrodes: int = 4) -> Linearisation:
    random = np.random.default_rng(seed)
    charges = random.uniform(100.0, 900.0, (5, electrodes))
    return Linearisation(charges, random.normal(size=(5, electrodes, 3)) * 50.0, 1.0)


def part(linearised: Linearisation, electrodes: slice) -> Linearisation:
    return Linearisation(
        linearised.charges_pC[:, electrodes], linearised.jacobian[:, electrodes], linearised.force_N
    )


def test_information_of_electrodes_adds_up_and_more_of_it_never_harms() -> None:
    full, noise = made_up(electrodes=6), Noise()
    parts = [part(full, slice(0, 3)), part(full, slice(3, 6))]
    total = sum(subset.information(noise) for subset in parts)
    np.testing.assert_allclose(full.information(noise), total, rtol=1e-12)
    for subset in parts:
        assert (full.position_errors_mm(noise) < subset.position_errors_mm(noise)).all()


def test_errors_are_linear_in_the_noise() -> None:
    response = made_up()
    once, thrice = Noise(0.01, 1.0), Noise(0.03, 3.0)
    for errors in (Linearisation.position_errors_mm, Linearisation.force_errors):
        np.testing.assert_allclose(errors(response, thrice), 3.0 * errors(response, once))


def test_covariance_is_that_of_weighted_least_squares() -> None:
    response, noise = made_up(), Noise(0.01, 2.0)
    J, sigma = response.jacobian[0], noise.deviations_pC(response.charges_pC[0])
    estimator = np.linalg.pinv(J / sigma[:, None]) / sigma
    np.testing.assert_allclose(
        response.covariance(noise)[0], estimator @ np.diag(sigma**2) @ estimator.T, rtol=1e-9
    )


def test_a_change_that_a_touch_would_make_is_taken_for_it() -> None:
    linearised, step = made_up(), np.array([0.3, -0.2, 0.05])
    found = linearised.shifts(Noise(), linearised.jacobian @ step)
    np.testing.assert_allclose(found, np.tile(step, (5, 1)), rtol=1e-9)


def test_two_electrodes_do_not_tell_three_unknowns_and_a_failed_solve_is_no_number() -> None:
    pair = part(made_up(), slice(0, 2))
    assert np.isinf(pair.position_errors_mm(Noise())).all()
    failed = made_up()
    failed.jacobian[2] = np.nan
    errors = failed.position_errors_mm(Noise())
    assert np.isnan(errors).tolist() == [False, False, True, False, False]
    assert np.isnan(quantile(errors, 0.5))
    assert quantile(np.array([3.0, 1.0, np.inf, 2.0]), 0.75) == 3.0


def test_polar_maps_of_a_smooth_function_and_their_gradients_are_exact_through_the_centre() -> None:
    radii, angles = np.arange(0.0, 10.1, 0.5), np.arange(24) * np.pi / 12.0
    x, y = radii[:, None] * np.cos(angles), radii[:, None] * np.sin(angles)
    samples = np.exp(0.2 * x - 0.1 * y) + x * y**2 / 50.0
    places = np.array([[0.0, 0.0], [0.1, -0.2], [-3.3, 4.1], [7.0, 2.0]])
    value, gradient = PolarMap(radii, samples[..., None]).value_and_gradient(places)
    x, y = places.T
    wave = np.exp(0.2 * x - 0.1 * y)
    np.testing.assert_allclose(value[:, 0], wave + x * y**2 / 50.0, atol=1e-4)
    np.testing.assert_allclose(gradient[:, 0, 0], 0.2 * wave + y**2 / 50.0, atol=1e-3)
    np.testing.assert_allclose(gradient[:, 0, 1], -0.1 * wave + x * y / 25.0, atol=1e-3)


def test_resolution_has_the_symmetry_of_the_sensor(study: Study) -> None:
    turned = PLACES @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    mirrored = PLACES * [1.0, -1.0]
    swapped = PLACES[:, ::-1]
    for sensor, images in ((THESIS, (turned, mirrored, swapped)), (drawn(THESIS), (mirrored,))):
        errors = study.linearisation(sensor, PLACES).position_errors_mm(study.noise)
        for places in images:
            image_errors = study.linearisation(sensor, places).position_errors_mm(study.noise)
            np.testing.assert_allclose(image_errors, errors, rtol=1e-9)
    swapped_errors = study.linearisation(drawn(THESIS), swapped).position_errors_mm(study.noise)
    errors_here = study.linearisation(drawn(THESIS), PLACES).position_errors_mm(study.noise)
    assert np.abs(swapped_errors / errors_here - 1.0).max() > 0.1


def test_jacobian_is_that_of_separate_solves_a_tenth_of_a_millimetre_apart(study: Study) -> None:
    place = np.array([4.0, 3.0])
    jacobian = study.linearisation(drawn(THESIS), place[None]).jacobian[0]
    fine = np.column_stack(
        [
            (_charges(place + step, 1.0) - _charges(place - step, 1.0)) / (2.0 * 0.1)
            for step in 0.1 * np.eye(2)
        ]
        + [(_charges(place, 1.02) - _charges(place, 0.98)) / 0.04]
    )
    scale = np.abs(fine).max(axis=0)
    assert np.abs((jacobian - fine) / scale).max() < 0.01


def _charges(place: np.ndarray, force_N: float) -> np.ndarray:
    probe = {"shape": "circle", "radius_mm": PROBE_RADIUS_MM, "x_mm": place[0], "y_mm": place[1]}
    scene = drawn(THESIS).scene(1e-5).with_(**{"probe": probe, "load.force_N": force_N})
    return np.array(list(solve(scene).charges_pC.values()))


def test_mirror_images_are_used_only_where_there_is_a_mirror() -> None:
    assert is_even(THESIS.alone(90.0, 1e-3))
    assert is_even(replace(THESIS, twist_deg=45.0).alone(0.0, 1e-3))
    assert not is_even(replace(THESIS, twist_deg=30.0).alone(0.0, 1e-3))
    oblong = replace(THESIS, width_mm=6.0, height_mm=1.5, twist_deg=45.0)
    assert not is_even(oblong.alone(0.0, 1e-3))
    assert is_even(drawn(THESIS).alone(90.0, 1e-3))
    assert not is_even(drawn(THESIS).alone(45.0, 1e-3))


def test_a_circle_has_the_area_of_the_square_and_no_electrodes_overlap(tmp_path: Path) -> None:
    round_one = replace(THESIS, shape="circle").scene(1e-3)
    assert round_one.electrode_list[0].outline.area == pytest.approx(9e-6, rel=1e-12)
    study = Study(Results(tmp_path, 1), LATTICE, Axes(spacings_mm=(4.0, 12.0), sides_mm=(3.0,)))
    assert [sensor.spacing_mm for sensor in rings(study, 4)] == [12.0]
    assert [len(sensor.scene(1e-3).electrode_list) for sensor in rings(study, 6)] == [6]


def test_the_choice_is_the_best_admissible_or_the_preferred_of_those_nearly_as_good() -> None:
    def candidate(merit: float, ring: float, admissible: bool = True) -> Alternative:
        return Alternative(str(merit), Sensor(ring_mm=ring), merit, admissible)

    alternatives = [candidate(0.9, 1.0, False), candidate(1.0, 2.0), candidate(1.05, 3.0)]
    alternatives += [candidate(1.5, 4.0), candidate(float("nan"), 5.0)]
    assert choose(alternatives).taken.merit == 1.0
    assert choose(alternatives, lambda sensor: sensor.ring_mm).taken.merit == 1.05
    with pytest.raises(ValueError, match=r"none of 0\.9, nan is admissible"):
        choose([alternatives[0], alternatives[-1]])


def test_the_page_is_complete_and_a_second_run_solves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--quick", "--out", str(tmp_path), "--processes", "1"]
    assert design.main(arguments) == 0
    assert capsys.readouterr().out.strip() == str(tmp_path / "index.html")
    assert_links_work(tmp_path / "index.html")
    text = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "Recommended: " in text
    with (tmp_path / "budget.csv").open(encoding="utf-8") as file:
        budget = {row["disturbance"]: row for row in csv.DictReader(file)}
    assert budget["open electrodes, not charge amplifiers"]["verdict_0"] == "negligible"
    assert budget["tapes over 1 mm of the electrodes"]["verdict_0"] == "matters"
    assert "nan" not in text
    with (tmp_path / "films.csv").open(encoding="utf-8") as file:
        thin, thick = sorted(csv.DictReader(file), key=lambda row: float(row["thickness_um"]))[:2]
    assert float(thin["sensitivity_pC_N_firm"]) > float(thick["sensitivity_pC_N_firm"])
    assert float(thin["stress_1_N_MPa"]) > float(thick["stress_1_N_MPa"])

    def solved(*_: object) -> None:
        raise AssertionError("solved again")

    monkeypatch.setattr("pvdf_fem.sweeps.sweep.records_of", solved)
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda *_, **__: None)
    assert design.main(arguments) == 0
