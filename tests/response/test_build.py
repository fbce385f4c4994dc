"""Builds: true to the solver, read anew for other electrodes, resumed, and never thrown away."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pvdf_fem import Response, Scene, build_response
from pvdf_fem.response import build
from pvdf_fem.response.build import ResponseOptions
from pvdf_fem.response.held_out import HeldOut, random_touches
from pvdf_fem.response.model import Domain
from pvdf_fem.response.probe_stress import ProbeMesh
from pvdf_fem.response.response_file import mechanics_of, response_key
from pvdf_fem.solvers.status import Status
from pvdf_fem.sweeps.store import code_version

ROOT = Path(__file__).parents[2]
DISC = Scene().with_(**{"probe.shape": "circle", "probe.radius_mm": 5.0, "film.d31_pC_N": 18.0})
# fewer places and touches than a real response has
OPTIONS = ResponseOptions(radii=2, held_out=4, attempts=1, least_mode=1e-7)
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
    made = build_response(DISC, tolerance=2e-3, file=path, **SMALL)
    assert [file.name for file in path.parent.iterdir()] == ["disc.response"]
    read = Response.load(path)
    touches = random_touches(made.domain, 5, seed=2)
    assert np.array_equal(read.evaluate(touches)[0], made.evaluate(touches)[0])
    return read


def errors_of(response, count=3):
    """Errors of charges at touches that the build has not seen, relative to |d31 X| + |d32 Y|."""
    touches = random_touches(response.domain, count, seed=9)
    solved = HeldOut.solved(response.scene, touches, 2e-4, 1)
    return solved.relative_errors(response.scene.film, response.evaluate(touches)[0])[0].max()


def test_a_response_is_true_to_the_solver(built):
    """Under a disc of 5 mm that comes close to the electrodes."""
    assert built.error_rms < built.error_bound < 2e-3
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


@pytest.mark.parametrize("d", [(9.0, 4.0), (2.0, 30.0), (5.0, 5.0)])
def test_other_coefficients_are_those_of_a_build_anew(built, d):
    """The first are both a half."""
    changes = dict(zip(("film.d31_pC_N", "film.d32_pC_N"), d, strict=True))
    scene = DISC.with_(**changes)
    found = built.for_scene(scene)
    anew = build_response(scene, tolerance=2e-3, **SMALL)
    assert found.scene == scene
    assert errors_of(found) < found.error_bound < 2e-3
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
    anew = build_response(scene, tolerance=2e-3, **SMALL)
    monkeypatch.setattr(build, "mean_stress_about_probe", None)
    found = built.for_scene(scene, 1)
    assert found.names == ("N", "far")
    touches = random_touches(built.domain, 20, seed=3)
    charges = anew.evaluate(touches)[0]
    assert found.evaluate(touches)[0] == pytest.approx(charges, rel=found.error_bound)
    assert found.error_bound < 2e-3
    assert errors_of(found) < found.error_bound
    monkeypatch.setattr(HeldOut, "solved", None)
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


KILLED = """
import os, sys
from pvdf_fem import build_response
from tests.response.test_build import DISC, SMALL
def progress(done, total):
    if done == int(sys.argv[2]):
        os._exit(9)
build_response(DISC, tolerance=2e-3, file=sys.argv[1], progress=progress, **SMALL)
"""


def test_a_killed_build_goes_on_where_it_was(tmp_path, monkeypatch, built):
    """It is killed once among the touches held out and once among the places, one of which is
    damaged besides.
    """
    path = tmp_path / "disc.response"
    for done in ("2", "5"):
        command = [sys.executable, "-c", KILLED, str(path), done]
        killed = subprocess.run(command, cwd=ROOT, capture_output=True, timeout=200)
        assert (killed.returncode, killed.stderr) == (9, b"")
    kept = list((tmp_path / "disc.response.part").glob("*.npy"))
    assert len(kept) == 1
    shown = []
    response = build_response(
        DISC, tolerance=2e-3, file=path, progress=lambda *at: shown.append(at), **SMALL
    )
    assert shown[-2:] == [(5, 6), (6, 6)]
    assert [file.name for file in tmp_path.iterdir()] == ["disc.response"]
    touches = random_touches(built.domain, 5)
    # another process may round otherwise
    expected = built.evaluate(touches)[0]
    np.testing.assert_allclose(response.evaluate(touches)[0], expected, rtol=1e-6)


def test_a_damaged_field_is_solved_again(tmp_path):
    file = tmp_path / "a.npy"
    assert build._read(file) is None
    np.save(file, np.arange(3.0))
    assert np.array_equal(build._read(file), [0.0, 1.0, 2.0])
    for damaged in (b"", b"\x93NUMPY\x01", b"PK"):
        file.write_bytes(damaged)
        assert build._read(file) is None


def test_a_missed_tolerance_returns_the_true_bound(tmp_path):
    path = tmp_path / "disc.response"
    response = build_response(DISC, tolerance=2e-5, file=path, **SMALL)
    touches = response.held_out.touches
    errors, stated = response.held_out.relative_errors(DISC.film, response.evaluate(touches)[0])
    bound = response.error_bound
    assert bound == pytest.approx(5.0 * errors.max() + stated)
    assert bound > 2e-5
    assert response.status is Status.TOLERANCE
    [remark] = response.remarks
    assert remark.startswith(f"tolerance: 2e-05 is missed, the error bound is {bound:.2g};")
    assert Response.load(path).remarks == response.remarks


def test_options_become_finer_until_the_tolerance_is_met(monkeypatch):
    bounds, tried = iter([9e-3, 1e-3]), []
    monkeypatch.setattr(build, "_stress", lambda *given: tried.append(given[2:4]))
    monkeypatch.setattr(build.Grid, "charges", lambda *_: None)
    monkeypatch.setattr(build.HeldOut, "solved", lambda *_: HeldOut(np.zeros((4, 4)), None, None))
    measured = lambda self: replace(self, error_bound=next(bounds))  # noqa: E731
    monkeypatch.setattr(Response, "measured", measured)
    several = {**SMALL, "options": replace(OPTIONS, attempts=3)}
    assert build_response(DISC, tolerance=2e-3, **several).error_bound == 1e-3
    first, second = tried
    assert second[0].radii > first[0].radii
    assert second[1].elements.probe_size < first[1].elements.probe_size


@pytest.mark.parametrize("shape", ["circle", "rectangle"])
def test_films_that_are_stiffer_in_one_direction(shape):
    """Against full solves; the stress about the rectangle depends on its rotation."""
    sizes = {"circle": {"radius_mm": 5.0}, "rectangle": {"width_mm": 9.0, "height_mm": 6.0}}
    scene = Scene().with_(**{"probe": {"shape": shape, **sizes[shape]}, **DRAWN})
    coarse = ProbeMesh(probe_size=0.4, disc_size=0.25, growth=0.5, film_size=0.2)
    options = replace(OPTIONS, rotations=6, elements=coarse)
    small = {**SMALL, "options": options, "reach_mm": 2.0}
    response = build_response(scene, tolerance=5e-3, **small)
    assert response.error_bound < 5e-3
    assert errors_of(response) < response.error_bound


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
