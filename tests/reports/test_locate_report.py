"""The reports on positions from charges, at a small size with made-up models."""

from __future__ import annotations

import numpy as np
import pytest

import reports.locate as report
from reports.locating.errors import FREE, LOCATED, TURNED, Trial, bounds_mm, located, triangulated
from reports.locating.models import electrodes_of, printed_positions, sensor
from tests.helpers.touch_models import DOMAIN, POINTS, Bumps

FEW = {
    "Table 3.1 row 1, three electrodes",
    "Table 5.1 row 2, four electrodes",
    "Table 5.2 row 5, four electrodes",
}
SMALL = [position for position in printed_positions() if position.case in FEW]


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
    model = model_of(sensor("triangle"))
    names = electrodes_of("four")
    touches = np.array([[5.0714, 0.8757, 0.0, 1.0], [-3.0, 2.0, 40.0, 0.5]])
    rows = [model.names.index(name) for name in names.values()]
    return Trial(model, names, touches, model.evaluate(touches)[0][:, rows])


def test_a_touch_without_a_solution_is_left_out(trial, tmp_path):
    class Failed:
        converged = False

    class Some(MadeUpResults):
        def __getitem__(self, scene):
            return Failed() if scene.probe.x_mm < 0.0 else super().__getitem__(scene)

    models = {("triangle", "biaxial"): trial.model}
    converged = report._trial("triangle", trial.touches, models, Some(tmp_path, 1))
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
    monkeypatch.setattr(report, "printed_positions", lambda: SMALL)
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
