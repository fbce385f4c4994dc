"""The reports on positions from charges, at a small size with made-up models."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import reports.experiment as experiment
import reports.locate as report
from pvdf_fem import Scene, solve
from pvdf_fem.scene.scene import Replaced
from reports.common.thesis_data import Thesis
from reports.locating.errors import FREE, LOCATED, TURNED, Trial, bounds_mm, located, triangulated
from reports.locating.film import taped, uneven_charges
from reports.locating.models import electrodes_of, sensor
from reports.locating.sources import SOURCES, Changed, MeasuredScene
from reports.locating.transducer import TransducerChanges, transducer_changes
from reports.thesis_methods.circuit import Circuit
from tests.helpers.touch_models import DOMAIN, POINTS, Bumps

THESIS = Thesis.read()
FEW = {
    "Table 3.1 row 1, 3 electrodes",
    "Table 5.1 row 2, 4 electrodes",
    "Table 5.2 row 5, 4 electrodes",
}
SMALL = replace(THESIS, positions=tuple(p for p in THESIS.positions if p.case in FEW))


def model_of(scene, *_):
    places = np.array([[e.x_mm, e.y_mm] for e in scene.electrode_list])
    names = tuple(e.name for e in scene.electrode_list)
    return Bumps(scene, POINTS[scene.probe.shape], places, names, domain=DOMAIN)


class MadeUpResults:
    """Records whose charges are those of the made-up model."""

    def __init__(self, folder, processes):
        folder.mkdir(parents=True, exist_ok=True)
        self.folder, self.processes = folder, processes

    def solve(self, scenes, progress):
        progress(len(scenes), len(scenes))

    def missing(self, scenes):
        return len(scenes)

    def __getitem__(self, scene):
        probe, model = scene.probe, model_of(scene)
        touch = np.array([[probe.x_mm, probe.y_mm, probe.rotation_deg, scene.load.force_N]])
        charges = dict(zip(model.names, model.evaluate(touch)[0][0].tolist(), strict=True))

        class MadeUpRecord:
            converged = True

            def charges_pC(self, *_):
                return charges

        return MadeUpRecord()


@pytest.fixture
def trial():
    model = model_of(sensor(THESIS, "tri7"))
    names = electrodes_of("4")
    touches = np.array([[5.0714, 0.8757, 0.0, 1.0], [-3.0, 2.0, 40.0, 0.5]])
    rows = [model.names.index(name) for name in names.values()]
    return Trial(model, names, touches, model.evaluate(touches)[0][:, rows])


def test_a_touch_without_a_solution_is_left_out(trial, tmp_path):
    class Failed:
        converged = False

    class Some(MadeUpResults):
        def __getitem__(self, scene):
            return Failed() if scene.probe.x_mm < 0.0 else super().__getitem__(scene)

    models = {("tri7", "biaxial"): trial.model}
    converged = report._trial(THESIS, "tri7", trial.touches, models, Some(tmp_path, 1))
    assert converged.touches == pytest.approx(trial.touches[:1])
    assert converged.charges_pC == pytest.approx(trial.charges_pC[:1])


def test_exact_charges_give_the_place_either_way(trial):
    assert triangulated(trial, 0.0, True).place_mm == pytest.approx([0.0, 0.0], abs=1e-3)
    errors = located(trial, 0.0)
    assert errors.place_mm == pytest.approx([0.0, 0.0], abs=1e-5)
    assert errors.force == pytest.approx([0.0, 0.0], abs=1e-6)
    # the contours of an unturned probe are wrong for a turned one only
    unturned, turned = triangulated(trial, 0.0, False).place_mm
    assert unturned < 1e-3 < turned


def test_the_bound_grows_with_the_noise(trial):
    at_one_percent, at_two_percent = bounds_mm(trial, 0.01), bounds_mm(trial, 0.02)
    assert at_two_percent == pytest.approx(2.0 * at_one_percent, rel=1e-6)
    assert np.all(bounds_mm(trial, 0.01, FREE).mean() > at_one_percent.mean())


def test_the_report_of_locations(tmp_path, monkeypatch):
    monkeypatch.setattr(report, "response_of", model_of)
    monkeypatch.setattr(report, "Results", MadeUpResults)
    monkeypatch.setattr(report, "FULL", report.Scope(map_across=3))
    monkeypatch.setattr(report.Thesis, "read", lambda: SMALL)
    assert report.main(["--out", str(tmp_path), "--touches", "2", "--processes", "1"]) == 0
    page = (tmp_path / "index.html").read_text()
    assert "100.0 % of the touches are found within 0.01 mm" in page
    rows = (tmp_path / "errors_triangle.csv").read_text().splitlines()
    assert len(rows) == 1 + 5 * 5
    assert any(row.split(",")[1] == LOCATED for row in rows)
    assert any(TURNED in row for row in rows)
    rows = (tmp_path / "errors_disc.csv").read_text().splitlines()
    assert len(rows) == 1 + 5 * 3
    assert {"resolution.svg", "ambiguity.svg"} <= {file.name for file in tmp_path.iterdir()}


# ------------------------------------------------------------------------------------ experiment


SCENE = Scene().with_(probe={"shape": "triangle", "x_mm": 4.1411, "y_mm": 5.4548})


def test_an_even_film_is_the_one_of_the_scene():
    charges = list(solve(SCENE).charges_pC.values())
    assert uneven_charges(SCENE)[0] == pytest.approx(charges, rel=1e-8)


def test_a_free_strain_is_that_of_a_temperature():
    colder = SCENE.with_(**{"film.temperature_change_K": -3.0})
    assert uneven_charges(SCENE, -colder.film.strain_at_rest) == pytest.approx(
        uneven_charges(colder), rel=1e-8
    )


def test_stretching_along_x_and_y_are_mirror_images():
    middle = SCENE.with_(probe=Replaced(shape="circle", radius_mm=3.0))
    e = -middle.film.strain_at_rest[0]
    along_x, along_y = (uneven_charges(middle, e * np.array(s))[0] for s in ([4, 0, 0], [0, 4, 0]))
    assert along_x == pytest.approx(along_y[[1, 0, 3, 2]], rel=1e-3)
    assert abs(along_x[0] / along_x[1] - 1.0) > 0.002


def test_tapes_take_load_from_the_rim():
    """As stiff as the film they are not there; stiffer ones raise every charge."""
    scene = taped(SCENE)
    assert len(scene.electrode_list) == 8
    without, soft, stiff = uneven_charges(scene, factors=(1.0, 4.0, 20.0))
    assert without == pytest.approx(uneven_charges(SCENE)[0], rel=0.01)
    assert np.all(soft > 1.05 * without)
    assert np.all(stiff > 1.05 * soft)


def test_the_transducer_changes_charges_as_it_must():
    """A disc over electrode A, on the mirror line of B and D."""
    disc = {"shape": "circle", "radius_mm": 3.0, "x_mm": 10.0, "y_mm": 0.0}
    scene = SCENE.with_(probe=disc, **{"numerics.tolerance": 2e-2})
    charges = np.array(list(solve(scene).charges_pC.values()))
    found = transducer_changes(scene, lambda jobs: [job() for job in jobs])
    pressed_pC = 15.0 * 0.5 * 9.0 / (9.0 * np.pi)
    assert np.expm1(found.across) * charges == pytest.approx(
        [pressed_pC, 0, 0, 0], rel=5e-2, abs=1e-6
    )
    assert np.all((found.open > 5e-4) & (found.open < 2e-3))
    assert abs(np.expm1(found.warm[0]) * charges[0] + 25.0 * 9.0) < 25.0
    assert np.all(np.diff(found.air, axis=0) < 0.0)
    assert np.all((found.covered > -0.4) & (found.covered < -0.1))
    for changes in (found.open, found.covered, found.air[0], found.varied[0], found.varied[2]):
        assert changes[1] == pytest.approx(changes[3], rel=0.1, abs=3e-4)


@pytest.fixture
def pressed():
    row = next(p for p in THESIS.positions if p.case == "Table 5.1 row 2, 4 electrodes")
    none, five = np.zeros(4), np.zeros((5, 4))
    transducer = TransducerChanges(none, none, none, np.zeros((3, 4)), none, np.zeros((4, 4)))
    changed = Changed(none, five, np.zeros((3, 4)), np.zeros((4, 4)), np.zeros((2, 4)), transducer)
    model = model_of(sensor(THESIS, row.probe))
    return MeasuredScene(row, model, electrodes_of("4"), Circuit(35e-12, 500e6), 23.0, changed)


@pytest.mark.parametrize("source", SOURCES, ids=lambda source: source.name)
def test_sources_change_charges_as_they_say(pressed, source):
    factors = source.draw(pressed, np.random.default_rng(1), 400)
    assert factors.shape == (400, 4)
    common = np.ptp(np.log(factors), axis=1)
    if source.name in ("probe placed",):
        assert 0.01 < common.mean() < 0.5
    elif source.name == "capacitances":
        assert set(np.count_nonzero(factors > 1.2, axis=1)) == {2}
        assert factors.max() < 35.0 / 23.0
    elif source.name in ("load resistance", "force fluctuates"):
        assert common.max() < 0.01 < np.log(factors).std()
    else:  # nothing changes where the finite elements saw no change
        assert factors == pytest.approx(1.0)


def test_the_report_of_the_experiment(tmp_path, monkeypatch, pressed):
    monkeypatch.setattr(experiment, "response_of", model_of)
    monkeypatch.setattr(experiment, "changes", lambda scene, workers: pressed.changed)
    monkeypatch.setattr(experiment.Thesis, "read", lambda: SMALL)
    assert experiment.main(["--out", str(tmp_path), "--samples", "40", "--processes", "1"]) == 0
    rows = (tmp_path / "sources.csv").read_text().splitlines()
    assert len(rows) == 1 + len(SOURCES) + 1
    assert len((tmp_path / "predicted_scenes.csv").read_text().splitlines()) == 3
    page = (tmp_path / "index.html").read_text()
    assert "too small to matter: " in page
    assert "root mean square of the measured errors is 0.37 mm" in page  # the other is lost


def test_models_are_built_before_the_workers_of_the_experiment(tmp_path, monkeypatch, pressed):
    """A build has workers of its own, which would end those of an open block of the same kind."""
    events = []

    class Workers(experiment.Parallel):
        def __enter__(self):
            events.append("workers")
            return super().__enter__()

    def built(scene, *_):
        events.append("model")
        return model_of(scene)

    monkeypatch.setattr(experiment, "Parallel", Workers)
    monkeypatch.setattr(experiment, "response_of", built)
    monkeypatch.setattr(experiment, "changes", lambda scene, workers: pressed.changed)
    monkeypatch.setattr(experiment.Thesis, "read", lambda: SMALL)
    assert experiment.main(["--out", str(tmp_path), "--samples", "20", "--processes", "1"]) == 0
    assert events == ["model", "model", "workers"]


def test_the_default_number_of_samples_may_be_given():
    default = experiment._options([]).samples
    assert experiment._options(["--samples", str(default)]).samples == default
