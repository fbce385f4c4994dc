"""Builds: true to the solver, read anew for other electrodes, resumed, and never thrown away."""

from __future__ import annotations

import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pvdf_fem import Response, Scene, build_response
from pvdf_fem.progress import Work
from pvdf_fem.response import build, response
from pvdf_fem.response.build import ResponseOptions
from pvdf_fem.response.held_out import HeldOut, random_touches, solves_of
from pvdf_fem.response.model import Domain
from pvdf_fem.response.response_file import mechanics_of, response_key
from pvdf_fem.solvers.status import Status
from pvdf_fem.sweeps.store import code_version

ROOT = Path(__file__).parents[2]
DISC = Scene().with_(**{"probe.shape": "circle", "probe.radius_mm": 5.0, "film.d31_pC_N": 18.0})
OPTIONS = ResponseOptions(error=1e-2, held_out=4, attempts=1)
TOLERANCE = 1e-2
SMALL = {"reach_mm": 3.0, "force_N": (0.8, 1.6), "processes": 1, "options": OPTIONS}
#: Stiffer along one axis, with charges of unequal coefficients.
DRAWN = {"film.youngs_modulus_GPa": [2.0, 3.0], "film.d31_pC_N": 20.0, "film.d32_pC_N": 3.0}


@pytest.fixture(scope="module", autouse=True)
def _remembered():
    """Stress about a probe is solved once for all builds with the same options."""
    solve, solved = build.mean_stress_about_probe, {}

    def once(scene, *rest):
        at = f"{mechanics_of(scene)} {rest}"
        if at not in solved:
            solved[at] = solve(scene, *rest)
        return solved[at]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build, "mean_stress_about_probe", once)
        yield


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """A small response, as its file has it."""
    path = tmp_path_factory.mktemp("built") / "disc.response"
    made = build_response(DISC, tolerance=TOLERANCE, file=path, **SMALL)
    assert [file.name for file in path.parent.iterdir()] == ["disc.response"]
    read = Response.load(path)
    touches = random_touches(made.domain, 5, seed=2)
    assert np.array_equal(read.evaluate(touches)[0], made.evaluate(touches)[0])
    return read


def errors_of(made, count=3):
    """Errors of charges at touches that the build has not seen, relative to |d31 X| + |d32 Y|."""
    touches = random_touches(made.domain, count, seed=9)
    found = [*Work(1).run(solves_of(made.scene, touches, 2e-4, share=1.0))]
    solved = HeldOut.of(touches, found)
    return solved.relative_errors(made.scene.film, made.evaluate(touches)[0])[0].max()


def test_a_response_is_true_to_the_solver(built):
    """Under a disc of 5 mm that comes close to the electrodes."""
    assert built.error_bound < TOLERANCE
    assert (built.status, built.remarks) == (Status.CONVERGED, ())
    assert errors_of(built) < built.error_bound


BLOCKED = """
import sys
class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("gmsh", "skfem"):
            raise ImportError(name)
sys.meta_path.insert(0, Blocked())
import numpy as np
from pvdf_fem import Response, Tracker, locate, locate_many
response = Response.load(sys.argv[1])
touch = np.array([1.0, 0.5, 0.0, 1.0])
charges = response.evaluate(touch)[0]
changes = charges[0] - response.at_rest_pC[0]
rows = dict(zip(response.names, charges.T.tolist()))
found = locate(response, {name: row[0] for name, row in rows.items()})
many = locate_many(response, rows)
changed = locate(response, dict(zip(response.names, changes.tolist())), reading="change")
tracker, draw = Tracker(response, unit="pC"), np.random.default_rng(1)
for k in range(600):
    tracker.update(1e-3 * k, (400 < k < 500) * changes + 0.3 * draw.standard_normal(4))
print(found.best.force_N, changed.best.force_N, many.values[0, 3], tracker.touches[0].force_N)
"""


def test_a_robot_needs_neither_gmsh_nor_scikit_fem(built, tmp_path):
    path = tmp_path / "robot.response"
    built.save(path)
    command = [sys.executable, "-W", "error", "-c", BLOCKED, str(path)]
    told = subprocess.run(command, capture_output=True, text=True, timeout=120, cwd=tmp_path)
    assert told.stderr == ""
    assert [float(word) for word in told.stdout.split()] == pytest.approx([1.0] * 4, rel=0.02)


def test_other_coefficients_are_those_of_a_build_anew(built):
    changes = {"film.d31_pC_N": 2.0, "film.d32_pC_N": 30.0}
    scene = DISC.with_(**changes)
    found = built.for_scene(scene)
    anew = build_response(scene, tolerance=TOLERANCE, **SMALL)
    assert found.scene == scene
    assert errors_of(found) < found.error_bound < TOLERANCE
    touches = random_touches(built.domain, 20, seed=3)
    sizes = np.abs(built.evaluate(touches)[0]).max()
    assert found.evaluate(touches)[0] == pytest.approx(anew.evaluate(touches)[0], abs=1e-6 * sizes)


def test_other_electrodes_are_read_from_the_same_stress(built, monkeypatch):
    """Far out, too, and without a solve for the stress; the bound is measured anew."""
    electrodes = [
        {"name": "N", "shape": "circle", "radius_mm": 2.0, "x_mm": -7.0, "y_mm": 3.0},
        {"name": "far", "shape": "square", "side_mm": 4.0, "x_mm": 12.0, "y_mm": 30.0},
    ]
    scene = DISC.with_(electrodes=electrodes)
    anew = build_response(scene, tolerance=TOLERANCE, **SMALL)
    monkeypatch.setattr(build, "mean_stress_about_probe", None)
    found = built.for_scene(scene, 1)
    assert found.names == ("N", "far")
    touches = random_touches(built.domain, 20, seed=3)
    charges = anew.evaluate(touches)[0]
    assert found.evaluate(touches)[0] == pytest.approx(charges, rel=found.error_bound)
    assert found.error_bound < TOLERANCE
    assert errors_of(found) < found.error_bound
    monkeypatch.setattr(response, "solves_of", None)
    for name in ("stress", "held_out"):
        with pytest.raises(ValueError, match="build it again"):
            replace(built, **{name: None}).for_scene(scene, 1)
    unchecked = built.for_scene(scene, 1, check=False)
    np.testing.assert_array_equal(unchecked.evaluate(touches)[0], found.evaluate(touches)[0])
    assert unchecked.error_bound == built.error_bound


def test_what_only_names_or_places_is_taken_over(built):
    named = [{**e.model_dump(), "name": f"{e.name}2"} for e in DISC.electrode_list]
    scene = DISC.with_(**{"electrodes": named, "probe.x_mm": 1.0, "load.force_N": 2.0})
    found = built.for_scene(scene)
    assert found.names == ("A2", "B2", "C2", "D2")
    assert found.spline is built.spline


@pytest.mark.parametrize(
    ("key", "value"),
    [("film.thickness_um", 30.0), ("probe.radius_mm", 4.0), ("load.kind", "follower")],
)
def test_another_deformation_is_refused_by_its_key(built, key, value):
    with pytest.raises(ValueError, match=f"{key} = {value} is .* build a response of this scene"):
        built.for_scene(DISC.with_(**{key: value}))


def test_progress_is_of_seconds_of_one_core():
    told = []
    begun = time.process_time()
    small = {**SMALL, "options": replace(OPTIONS, error=5e-2)}  # not among the remembered
    build_response(DISC, tolerance=5e-2, progress=lambda *at: told.append(at), **small)
    seconds = time.process_time() - begun
    done, total = np.transpose(told)
    assert (np.diff(done) > 0.0).all()
    assert done[-1] == pytest.approx(total[-1])
    assert 0.5 * seconds < done[-1] <= seconds
    assert total[0] == pytest.approx(total[-2], rel=0.5)  # before the table
    assert (done <= total + 1e-9).all()


def test_a_missed_tolerance_returns_the_true_bound(tmp_path):
    path = tmp_path / "disc.response"
    made = build_response(DISC, tolerance=5e-4, file=path, **SMALL)
    touches = made.held_out.touches
    errors, stated = made.held_out.relative_errors(DISC.film, made.evaluate(touches)[0])
    bound = made.error_bound
    assert bound == pytest.approx(5.0 * errors.max() + stated)
    assert bound > 5e-4
    assert made.status is Status.TOLERANCE
    [remark] = made.remarks
    assert remark.startswith("tolerance: ")
    assert Response.load(path).remarks == made.remarks


def test_options_become_finer_until_the_tolerance_is_met():
    coarse = ResponseOptions(error=0.1, held_out=4)
    built = (
        build_response(DISC, tolerance=2e-3, **{**SMALL, "options": replace(coarse, attempts=n)})
        for n in (1, 3)
    )
    once, again = (made.error_bound for made in built)
    assert again < 2e-3 < once


@pytest.mark.parametrize("shape", ["circle", pytest.param("rectangle", marks=pytest.mark.slow)])
def test_films_that_are_stiffer_in_one_direction(shape):
    """Against full solves; the stress about the rectangle depends on its rotation."""
    sizes = {"circle": {"radius_mm": 5.0}, "rectangle": {"width_mm": 9.0, "height_mm": 6.0}}
    scene = Scene().with_(**{"probe": {"shape": shape, **sizes[shape]}, **DRAWN})
    options = ResponseOptions(error=0.1, held_out=3, attempts=1)
    small = {**SMALL, "options": options, "reach_mm": 2.0}
    made = build_response(scene, tolerance=2e-2, **small)
    assert made.error_bound < 2e-2
    assert errors_of(made) < made.error_bound


def test_keys_are_of_mechanics_domain_tolerance_and_code(monkeypatch):
    """A change of a module that makes the table alone must not leave a stale response in use."""
    domain, near = Domain(12.0, (0.1, 5.0)), Domain(12.0, (0.1, 4.0))
    read = {"film.d31_pC_N": 3.0, "electrodes.side_mm": 2.0, "probe.x_mm": 2.0, "load.force_N": 3.0}
    assert response_key(DISC, domain, 1e-3) == response_key(DISC.with_(**read), domain, 1e-3)
    thick = DISC.with_(**{"film.thickness_um": 30.0})
    of = [(DISC, domain, 1e-3), (DISC, near, 1e-3), (DISC, domain, 1e-4), (thick, domain, 1e-3)]
    keys = {response_key(*each) for each in of}
    read_bytes = Path.read_bytes
    monkeypatch.setattr(
        Path, "read_bytes", lambda path: read_bytes(path) + b"#" * (path.parent.name == "response")
    )
    code_version.cache_clear()
    keys.add(response_key(DISC, domain, 1e-3))
    code_version.cache_clear()
    assert len(keys) == 5
