"""Nothing that the thesis prints goes missing: the whole report, on charges that cost nothing."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest

from pvdf_fem import Scene
from pvdf_fem.arrays import Array
from pvdf_fem.sweeps import sweep
from pvdf_fem.sweeps.store import Record
from reports import thesis
from reports.chapters import shear, summary, unexplained
from reports.chapters.film_placement import chapter as film_placement
from reports.chapters.film_placement import fits
from reports.chapters.film_placement.sensor import SensorStates, ThesisContours, Touch
from reports.chapters.force_and_angle import angle
from reports.chapters.transducer import effects, moving, taped
from reports.common import figures
from reports.common.thesis_data import Thesis
from reports.maps import carried
from tests.reports.test_page import Links, assert_links_work

DATA = Thesis.read()


def made_up(scene: Scene) -> Record:
    """Charges that fall with the distance and grow with the force to the power 2/3."""
    force = scene.load.force_N * 25.0 / scene.film.thickness_um
    place = np.zeros(2) if scene.probe is None else [scene.probe.x_mm, scene.probe.y_mm]
    distances = [np.linalg.norm(1e3 * e.outline.centroid - place) for e in scene.electrode_list]
    charge_forces = [
        [(3.0 + 200.0 * force ** (2 / 3) / (1.0 + (r / 9.0) ** 2)) / 2.0] * 2 for r in distances
    ]
    names = tuple(e.name for e in scene.electrode_list)
    forces = {"material": charge_forces, "thesis-edge": charge_forces}
    return Record("converged", "", names, forces, forces, 3.0, (), 0.0)


def made_up_errors_mm(touch: Touch, contours: ThesisContours, states: SensorStates) -> Array:
    """Errors of positions that grow with the film's shift and turn, differently by touch."""
    weights = 1.0 + 0.1 * np.array(touch.case.target_mm)
    return 1.0 + 0.1 * np.abs(states.turns_deg) + np.abs(states.shifts_mm @ weights)


def cost_nothing(patched: pytest.MonkeyPatch) -> None:
    """The solves of effects that no store keeps, fine meshes of the others, and the crossings of
    contours in hundreds; pages before the end."""
    patched.setattr(thesis.Report.make, "__defaults__", (np.inf,))
    patched.setattr(shear, "deviations_N", lambda *of: (np.full(2, 0.1), np.full(2, 0.2)))
    patched.setattr(shear, "telling_noise", lambda *of: 0.02)
    patched.setattr(fits, "position_errors_mm", made_up_errors_mm)
    for size, coarse in (("_PROBE_SIZE", 0.5), ("_FILM_SIZE", 0.4), ("_PLACES_ACROSS", 121)):
        patched.setattr(carried, size, coarse)
    on_its_mesh = {name: 600.0 for name in "ABCD"}
    patched.setattr(summary, "charges_on_thesis_mesh", lambda s, _: dict.fromkeys(s, on_its_mesh))
    patched.setattr(unexplained, "in_tilted_axes_pC", lambda scene: {"A": 600.0, "B": 600.0})
    charges = np.array([1100.0, 700.0, 500.0, 600.0])
    air = dict.fromkeys(moving.AIR, 100.0)
    patched.setattr(effects, "charges_pC", lambda scene: charges)
    patched.setattr(taped, "totals_pC", lambda scene: charges)
    patched.setattr(effects, "oscillating_ratios", lambda *of: np.full(4, 1.01))
    patched.setattr(effects, "found", lambda *of, **how: effects.Found(5.0, 1.0, 1.0, 0.5))
    warm = {"x_mm": 5.0, "y_mm": 1.0, "force_N": 1.0, "temperature_K": 10.0}
    patched.setattr(effects.Effect, "found_with_temperature", lambda *of: warm)
    patched.setattr(effects.Effect, "deviations_with_temperature", lambda *of: np.full(4, 0.1))
    patched.setattr(moving, "motion", lambda force_N, f: moving.Motion(force_N, air, air, 5.0))


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Links]:
    out = tmp_path_factory.mktemp("report")
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(sweep, "records_of", lambda scenes, frames: list(map(made_up, scenes)))
        patched.setattr(film_placement, "DRAWS", 5)
        patched.setattr(angle, "_half_range", lambda *of: 1.0)
        # figures are written in the quick report
        patched.setattr(figures, "save", lambda figure, path: path.touch())
        cost_nothing(patched)
        thesis.main(["--out", str(out), "--processes", "1", "--quiet"])
    return out, assert_links_work(out / "thesis.html")


def column(out: Path, *keys: str) -> set[tuple[str, ...]]:
    """Values of some columns in all tables that have them."""
    values: set[tuple[str, ...]] = set()
    for path in out.glob("*.csv"):
        with path.open(encoding="utf-8", newline="") as stream:
            reader = csv.DictReader(stream)
            if set(keys) <= set(reader.fieldnames or ()):
                values |= {tuple(row[key] for key in keys) for row in reader}
    return values


def test_every_section_is_made(report: tuple[Path, Links]) -> None:
    _, links = report
    assert "This section failed" not in links.text
    assert "not computed yet" not in links.text


def test_every_charge_is_there(report: tuple[Path, Links]) -> None:
    shown = {row[:2] for row in column(report[0], "case_id", "electrode", "ours_pC", "status")}
    assert shown == {(charge.case, charge.electrode) for charge in DATA.charges}


def test_every_position_is_there(report: tuple[Path, Links]) -> None:
    shown = {row[0] for row in column(report[0], "case", "thesis_mm", "least_squares_mm")}
    assert shown == {position.case for position in DATA.positions}


def test_every_point_of_a_triangulation_is_there(report: tuple[Path, Links]) -> None:
    shown = {row[:2] for row in column(report[0], "case", "item", "true_x_mm")}
    assert shown == {(point.case, point.item) for point in DATA.triangulation}


def test_every_point_of_a_contour_is_there(report: tuple[Path, Links]) -> None:
    shown = {
        (contour, float(angle))
        for contour, angle, _ in column(report[0], "contour", "angle_deg", "ours_mm")
    }
    assert shown == {(point.contour, point.angle_deg) for point in DATA.contours}


def test_every_angle_is_there(report: tuple[Path, Links]) -> None:
    shown = {row[0] for row in column(report[0], "case", "equation_deg", "ours_deg")}
    assert shown == {estimate.case for estimate in DATA.angle_estimates}


def test_every_figure_and_table_is_there(report: tuple[Path, Links]) -> None:
    """Figures of chapters 1 and 5 may be left out; the list says why."""
    shown = {name for chapter in thesis.CHAPTERS for name in chapter.shows}
    figures = {f"Fig. {f.number}" for f in DATA.figures}
    tables = set(summary.TABLES)
    assert {c.source.partition(",")[0][:9] for c in DATA.from_("Table")} <= tables
    assert {name for name in figures if name[5] in "234"} | tables - {"Table 2.1"} <= shown
    assert figures - shown == set(summary.LEFT_OUT)
    listed = dict(column(report[0], "item", "where"))
    assert set(listed) == figures | tables
    titles = {chapter.title for chapter in thesis.CHAPTERS}
    assert {item for item, where in listed.items() if where in titles} == (shown & set(listed))


def test_findings_lead_to_their_sections(report: tuple[Path, Links]) -> None:
    titles = {chapter.title for chapter in thesis.CHAPTERS}
    assert {shown for (shown,) in column(report[0], "shown")} <= titles
    assert not re.search(r">[^<]*\b(t4[156]_|s3[12][12]_|tri7|rect14x7|own lines)", report[1].text)
