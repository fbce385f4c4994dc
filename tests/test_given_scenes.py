"""Public functions take a path, tables or a result for a scene, and tell mistakes by name."""

import math
import pickle
import re

import pytest

import pvdf_fem
from pvdf_fem import Scene, gradients, modes, respond, solve, sweep
from tests.helpers.touch_models import bumps

TABLES = {
    "film": {"radius_mm": 12.0, "density_kg_m3": 1780.0},
    "electrodes": {"ring_radius_mm": 6.0},
    "probe": {"shape": "circle"},
    "numerics": {"tolerance": 0.05},
}
SCENE = Scene().with_(TABLES)


@pytest.fixture(scope="module")
def solution():
    return solve(SCENE)


def test_a_path_tables_and_a_solution_are_solved(tmp_path, solution):
    path = tmp_path / "mine.toml"
    path.write_text(SCENE.to_toml(), encoding="utf-8")
    for given in (str(path), path, TABLES, solution):
        assert solve(given).charges_pC == solution.charges_pC


def test_studies_take_a_solution_or_tables(solution):
    assert modes(solution, 1).frequencies_Hz == modes(SCENE, 1).frequencies_Hz
    keys = ["load.force_N"]
    assert gradients(TABLES, keys) == gradients(solution, keys)
    swept = sweep(solution, [{"load.force_N": [1.0]}], processes=1)
    assert swept.charge_pC.sel(force_N=1.0).values == pytest.approx(
        list(solution.charges_pC.values()), rel=0.05
    )
    ours, theirs = (respond(given, [10.0]).charges_pC_N for given in (TABLES, solution))
    assert ours == theirs


@pytest.mark.parametrize("name", ["solve", "modes", "gradients", "respond", "sweep"])
@pytest.mark.parametrize("given", [3.0, None, [1.0]])
def test_what_is_no_scene_is_told(name, given):
    more = {"respond": [[10.0]], "sweep": [[{"load.force_N": [1.0]}]]}.get(name, [])
    with pytest.raises(TypeError, match="scene = "):
        getattr(pvdf_fem, name)(given, *more)


#: Mistakes in Python, with the name that the complaint begins with. `s` is a solution, `S` a scene,
#: `m` a model.
MISTAKES = {
    "pf.solve(S, force=2)": "solve",
    "pf.solve()": "solve",
    "pf.solve(S, 'a.msh')": "solve",
    "pf.step(force=2)": "step",
    "pf.solve(S, mesh=3)": "mesh",
    "pf.solve(S, order='2')": "order",
    "pf.solve(S, order=7)": "order",
    "pf.solve(S, budget=3)": "budget",
    "pf.solve(S, pressure='hertz')": "pressure",
    "pf.solve(S, uncertain='5 %')": "uncertain",
    "pf.solve(S, uncertain={'bad': '5 %'})": "uncertain.bad",
    "pf.solve({3: 2})": "3",
    "pf.modes(S, '6')": "count",
    "pf.modes(S, 0)": "count",
    "pf.modes(S, 201)": "count",
    "pf.modes(S, 2.5)": "count",
    "pf.modes(S, True)": "count",
    "pf.modes(S, loaded='yes')": "loaded",
    "pf.respond(s, '20')": "frequencies_Hz",
    "pf.respond(s, None)": "frequencies_Hz",
    "pf.respond(s, [-1])": "frequencies_Hz",
    "pf.respond(s, [])": "frequencies_Hz",
    "pf.respond(s, 20, 30)": "refined",
    "pf.transient(s, 0.1, [0, 1])": "touch",
    "pf.transient(s, ((1, 2),), [0, 1])": "touch",
    "pf.transient(s, pf.step(0.1), None)": "times_s",
    "pf.transient(s, pf.step(0.1), [0, math.nan])": "times_s",
    "pf.transient(s, pf.step(0.1), [0], highest_Hz=-3)": "highest_Hz",
    "pf.step('a')": "force_N",
    "pf.half_sine(0.1, 0)": "duration_s",
    "pf.gradients(s, ['bad'])": "parameters",
    "pf.gradients(s, [3])": "parameters[0]",
    "pf.gradients(s, [])": "parameters",
    "pf.gradients(s, tolerance='a')": "tolerance",
    "pf.uncertainty(s, ['film.thickness_um'])": "uncertain",
    "pf.sweep(S, {'load.force_N': [1]})": "axes",
    "pf.sweep(S, [{'load.force_N': [1]}], processes='all')": "processes",
    "pf.sweep(S, [{'load.force_N': [1]}], store=3)": "store",
    "S.with_('load.force_N=3')": "changes",
    "S.with_(load=3)": "load",
    "S.with_({'load.force_N': None})": "load.force_N",
    "pf.Scene.load(3)": "path",
    "pf.Scene.load()": "load",
    "pf.Scene.example()": "example",
    "pf.Scene.parse(3)": "text",
    "pf.Scene('mine.toml')": "Scene",
    "s.at([0, 1], [0, 1, 2])": "x_mm",
    "s.at('a', 0)": "x_mm",
    "s.at(0, None)": "y_mm",
    "s.at(0, 0, outside='zero')": "outside",
    "s.along([(0, 0)])": "line_mm",
    "s.along([(0, 0), (1, 1)], points=1)": "points",
    "s.to_xarray(-1)": "step_mm",
    "s.to_xarray('a')": "step_mm",
    "s.to_vtu(3)": "path",
    "s.plot(reach_mm='a')": "reach_mm",
    "s.plot(reach_mm=-3)": "reach_mm",
    "s.plot(ax=3)": "ax",
    "s.plot(['stress'])": "quantity",
    "s.plot(colour='red')": "plot",
    "s.view(scale='a')": "scale",
    "s.charges_by('a', 3)": "d31_pC_N, d32_pC_N",
    "s.charges_by(8)": "charges_by",
    "s.readings_V": "readout",
    "pf.locate(S, [1, 2, 3])": "charges",
    "pf.locate(s, {'A': 700.0}, unknown=3)": "unknown",
    "pf.locate(m, {'A': 700.0}, known=3)": "known",
    "pf.locate_many(m, [[1, 2, 3, 'a']])": "charges_pC",
    "pf.locate_many(m, [[9, 7, 6, 6.0]], forces_N='a')": "forces_N",
    "pf.locate_many(S, [[1, 2, 3, 4]])": "model",
    "pf.calibrate(S, 3)": "touches",
    "pf.calibrate(s, 'none.csv', sigma='a')": "sigma",
    "pf.calibrate(s, 'none.csv', priors=3)": "priors",
    "pf.build_response(TABLES, tolerance='a')": "tolerance",
    "pf.build_response(S, force_N=3)": "force_N",
    "pf.build_response(S, processes='all')": "processes",
    "pf.Response.load(None)": "path",
    "pf.Tracker(S)": "model",
    "pf.Tracker()": "Tracker",
    "pf.Tracker(m, unknown=3)": "unknown",
    "pf.Tracker(m).update(0, {'Z': 1})": "readings.Z",
    "pf.Tracker(m).update(0, ['a', 2, 3, 4])": "readings",
    "pf.design(s, ['electrodes.count'])": "vary",
    "pf.design(s, {'load.force_N': [1]}, reach_mm='a')": "reach_mm",
    "pf.design(s, {'load.force_N': [1]}, force_range_N=3)": "force_range_N",
    "pf.design(s, {'load.force_N': [1]}, model=3)": "model",
    "pf.dataset(TABLES, touches='many')": "touches",
    "pf.dataset(TABLES, model=3)": "model",
    "pf.Report.load(3)": "path",
}


GIVEN = {"pf": pvdf_fem, "math": math, "TABLES": TABLES, "S": SCENE, "m": bumps("circle")}


@pytest.mark.parametrize("call", MISTAKES)
def test_a_mistake_is_told_by_its_name(call, solution):
    with pytest.raises((ValueError, TypeError)) as refused:
        eval(call, {**GIVEN, "s": solution})
    told, name = getattr(refused.value, "problems", [str(refused.value)])[0], MISTAKES[call]
    assert re.match(rf"{re.escape(name)}( = | has |: )", told)


@pytest.mark.parametrize(
    ("call", "name"),
    [
        *(("S.film.radius_mm = 3", "radius_mm"), ("S.load = 3", "load")),
        *(("S.probe.width", "width"), ("s.charges['A']", "charges_pC")),
        *(("s.at(0, 0).stress", "stress_MPa"), ("pf.solv", "did you mean solve")),
    ],
)
def test_attributes_are_told_by_name(call, name, solution):
    with pytest.raises(AttributeError, match=name):
        exec(call, {**GIVEN, "s": solution})


def test_public_functions_can_be_sent_to_other_processes():
    assert pickle.loads(pickle.dumps(solve)) is solve
