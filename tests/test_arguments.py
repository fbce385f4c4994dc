"""Public functions take a path, tables or a result for a scene, and tell mistakes by name."""

from __future__ import annotations

import inspect
import math
import re
from functools import reduce

import pytest

import pvdf_fem
from pvdf_fem import Scene, gradients, modes, respond, solve, sweep
from pvdf_fem.scene.arguments import as_scene
from tests.helpers.bump_response import make_bump_response
from tests.helpers.refusals import refused

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


def test_a_path_tables_a_scene_or_a_solution_stands_for_a_scene(tmp_path, solution):
    path = tmp_path / "mine.toml"
    path.write_text(SCENE.to_toml(), encoding="utf-8")
    for given in (path, str(path), TABLES, SCENE, solution):
        assert as_scene(given) == SCENE
    for wrong in (tmp_path / "none.toml", {"film": {"radius": 2}}):
        assert refused(as_scene, wrong)


def test_functions_accept_a_solution_or_tables_for_a_scene(solution):
    assert solve(solution).charges_pC == solve(TABLES).charges_pC == solution.charges_pC
    assert modes(solution, 1).frequencies_Hz == modes(SCENE, 1).frequencies_Hz
    keys = ["load.force_N"]
    assert gradients(TABLES, keys) == gradients(solution, keys)
    swept = sweep(solution, [{"load.force_N": [1.0]}], processes=1)
    assert swept.charge_pC.sel(force_N=1.0).values == pytest.approx(
        list(solution.charges_pC.values()), rel=0.05
    )
    ours, theirs = (respond(given, [10.0]).charges_pC_N for given in (TABLES, solution))
    assert ours == theirs


#: Public functions and methods, with arguments that they take. `s` is a solution, `S` a scene, `m`
#: a model.
CALLS = {
    "solve": "S",
    "materials": "'pet'",
    "modes": "S",
    "gradients": "s",
    "uncertainty": "s, {'film.thickness_um': '5 %'}",
    "respond": "s, [10.0]",
    "transient": "s, pf.step(0.1), [0.0]",
    "step": "0.1",
    "half_sine": "0.1, 0.1",
    "sweep": "S, [{'load.force_N': [1.0]}]",
    "calibrate": "s, 'none.csv'",
    "build_response": "S",
    "locate": "m, dict.fromkeys('ABCD', 700.0)",
    "locate_many": "m, [[9.0, 7.0, 6.0, 6.0]]",
    "design": "S, {'load.force_N': [1.0]}",
    "dataset": "S",
    "write_deck": "s, 'none.inp'",
    "compare_deck": "s, 'none.dat'",
    "draw": "S, 'none.svg'",
    "Tracker": "m",
    "Solution.at": "s, 0.0, 0.0",
    "Solution.along": "s, [(0.0, 0.0), (1.0, 1.0)]",
    "Solution.to_xarray": "s",
    "Solution.to_vtu": "s, 'none.vtu'",
    "Solution.plot": "s",
    "Solution.view": "s",
    "Solution.charges_by": "s, 8.0, 8.0",
}
#: What only developers give, and what is a callable or a truth value.
UNCHECKED = ("self", "options", "progress")
#: Arguments that go by another name in complaints.
ALIASES = {"solution": "scene", "response": "(response|model|scene)"}
ALIASES |= {"d31_pC_N": ".*", "d32_pC_N": ".*"}


def function_of(name):
    return reduce(getattr, name.split("."), pvdf_fem)


def parameters():
    """Each public function with each argument."""
    for name in CALLS:
        taken = inspect.signature(function_of(name)).parameters
        yield from ((name, key) for key in taken if key not in UNCHECKED)


GIVEN = {
    "pf": pvdf_fem,
    "math": math,
    "TABLES": TABLES,
    "S": SCENE,
    "m": make_bump_response("circle"),
}


@pytest.mark.parametrize(("name", "argument"), [*parameters()])
def test_an_invalid_argument_is_reported_by_its_name(name, argument, solution):
    function = function_of(name)
    given = eval(f"({CALLS[name]},)", {**GIVEN, "s": solution})
    arguments = inspect.signature(function).bind(*given).arguments
    with pytest.raises((ValueError, TypeError)) as mistake:
        function(**{**arguments, argument: object()})
    assert begins(mistake.value, ALIASES.get(argument, argument))
    if inspect.isfunction(function):
        with pytest.raises(TypeError) as mistake:
            function(**arguments, nothing=1)
        assert begins(mistake.value, function.__name__)


def begins(error, name):
    """Whether the first line of an error begins with a name, or with a call of that name."""
    line = getattr(error, "problems", [str(error)])[0]
    return re.match(rf"(\w+\.)?{name}( = | has |: |(\.__init__)?\(\) )", line)


def test_every_public_function_is_called_here():
    public = {name for name in pvdf_fem.__all__ if inspect.isfunction(function_of(name))}
    assert public <= CALLS.keys()


#: Mistakes in values, with the name that the complaint begins with.
MISTAKES = {
    "pf.solve(S, 'a.msh')": "solve",
    "pf.solve(S, order=7)": "order",
    "pf.solve(S, pressure='hertz')": "pressure",
    "pf.modes(S, 0)": "count",
    "pf.respond(s, [-1])": "frequencies_Hz",
    "pf.respond(s, [])": "frequencies_Hz",
    "pf.respond(s, 20, 30)": "refined",
    "pf.transient(s, ((1, 2),), [0, 1])": "force_history",
    "pf.transient(s, pf.step(0.1), [0, math.nan])": "times_s",
    "pf.half_sine(0.1, 0)": "duration_s",
    "pf.gradients(s, ['bad'])": "parameters",
    "pf.gradients(s, [])": "parameters",
    "pf.uncertainty(s, ['film.thickness_um'])": "uncertain",
    "pf.sweep(S, {'load.force_N': [1]})": "axes",
    "S.with_('load.force_N=3')": "changes",
    "S.with_(load=3)": "load",
    "pf.Scene.from_file(3)": "path",
    "pf.Scene('mine.toml')": "Scene",
    "s.at([0, 1], [0, 1, 2])": "x_mm",
    "s.along([(0, 0)])": "line_mm",
    "s.to_xarray(-1)": "step_mm",
    "s.plot(['stress'])": "quantity",
    "s.readings_V": "readout",
    "pf.locate(S, [1, 2, 3])": "readings",
    "pf.Tracker(m).update(0, ['a', 2, 3, 4])": "readings",
    "pf.design(s, ['electrodes.count'])": "vary",
    "pf.Tracker()": "Tracker",
    "pf.draw(S, 'a.png')": "path",
    "pf.draw(S, 'a.dxf', dxf_version='R13')": "dxf_version",
    "pf.design(s, {'load.force_N': [1]}, response=3)": "response",
}


@pytest.mark.parametrize("call", MISTAKES)
def test_a_wrong_value_is_reported_by_its_name(call, solution):
    with pytest.raises((ValueError, TypeError)) as mistake:
        eval(call, {**GIVEN, "s": solution})
    assert begins(mistake.value, re.escape(MISTAKES[call]))


@pytest.mark.parametrize(
    ("call", "name"),
    [
        *(("S.film.radius_mm = 3", "radius_mm"), ("S.load = 3", "load")),
        *(("S.probe.width", "width"), ("s.charges['A']", "charges_pC")),
        *(("s.at(0, 0).stress", "stress_MPa"), ("pf.solv", "did you mean solve")),
    ],
)
def test_unknown_attributes_are_reported_by_name(call, name, solution):
    with pytest.raises(AttributeError, match=name):
        exec(call, {**GIVEN, "s": solution})
