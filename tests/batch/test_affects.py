"""Every key of a scene, changed alone: sweeps, stores and responses see it, or nothing changes."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import numpy as np
import pytest

from pvdf_fem import Scene, SceneError, Solution, solve
from pvdf_fem.batch.keys import make_record_key
from pvdf_fem.batch.plan import plan_solves
from pvdf_fem.scene.changes import parse_key
from pvdf_fem.scene.keys import Section
from pvdf_fem.scene.registry import PROBE_SHAPES, PROFILE_ENTRIES
from pvdf_fem.scene.validation.table_forms import TABLES as SCENE_TABLES
from pvdf_fem.scene.validation.table_forms import TableForm, list_forms
from pvdf_fem.surrogate.response_key import require_same_mechanics
from reports.guide.scene_keys import DRAWN_ELECTRODES, TABLES
from tests.helpers.discs import on_mesh

Changes = dict[str, Any]

DISC = {"shape": "circle", "radius_mm": 2.5, "x_mm": 2.0, "y_mm": 1.0}
PLAIN = {"film.radius_mm": 20.0, "film.d31_pC_N": 18.0, "film.d32_pC_N": 2.0}
PLAIN |= {"electrodes.ring_radius_mm": 8.0, "probe": DISC, "numerics.tolerance": 5e-2}
BASE = Scene().with_(PLAIN)
SIZES: dict[str, Changes] = {
    "circle": {"radius_mm": 2.5},
    "ellipse": {"semi_axes_mm": [3.0, 2.0]},
    "polygon": {"vertices_mm": [[0.0, 0.0], [3.0, 0.0], [0.0, 4.0]]},
    "polyline": {"vertices_mm": [[0.0, 0.0], [3.0, 0.0], [0.0, 4.0]], "bulges": [0.0, 0.3, 0.0]},
    "rectangle": {"width_mm": 3.0, "height_mm": 2.0},
    "sphere": {"radius_mm": 5.0},
    "square": {"side_mm": 3.0},
    "triangle": {"side_mm": 4.0},
}
LAYER = {"thickness_um": 30.0, "youngs_modulus_GPa": 3.0, "poisson_ratio": 0.3}
LAYER |= {"bonded": "before stretching", "density_kg_m3": 1e3}
LIFTING = {"film.backing_N_m3": 1e4, "film.pressure_Pa": -10.0}
FILM = {"film.pressure_Pa": 10.0, "film.gravity_m_s2": 20.0, "film.rim_displacement_um": [1.0]}
HEAT = {"film.pyroelectric_uC_m2K": 5.0, "film.warming_K": 0.4, "probe.temperature_K": 5.0}
COUPLED = {"film.coupling": True, "readout": {"kind": "voltage", "cable_capacitance_pF": 100.0}}
TOLD = {"readout": {"reading": "total"}, "stage": {"x_mm": 1.0}}
CALIBRATED = {"keys": ["film.thickness_um"], "deviations": [0.5]}
TOLD |= {"calibration": CALIBRATED}
MOVED = {"x_mm", "y_mm", "rotation_deg", "force_N"}  #: Keys that responses follow.
#: Scenes in which keys act, by changes of `BASE`, and the tables whose keys are changed there.
SCENES: list[tuple[Changes, list[str]]] = [
    ({}, ["", "film", "electrodes", "probe", "load", "numerics"]),
    ({**TOLD, "air": {}, "model": {}}, ["readout", "stage", "calibration", "air", "model"]),
    (FILM, ["film", "load"]),
    (LIFTING, ["film"]),
    ({**HEAT, "film.d33_pC_N": -10.0, "probe.x_mm": 7.0}, ["film", "probe"]),
    ({**COUPLED, "film.d31_pC_N": 60.0, "film.d32_pC_N": 60.0}, ["film", "readout"]),
    ({"film.youngs_modulus_GPa": [2.0, 3.0], "film.shear_modulus_GPa": 1.0}, ["film"]),
    ({"film.pretension_N_m": [9.0, 8.0]}, ["film", "probe"]),
    ({"load.kind": "contact", "probe.edge_radius_mm": 2.0}, ["probe", "load"]),
    ({"load.kind": "contact", "load.depth_mm": 0.2, "probe.edge_radius_mm": 2.0}, ["load"]),
    ({"load.profile": "gaussian", "load.profile_width_mm": 1.0}, ["load"]),
    ({"load": {"kind": "rigid", "contact": "stuck", "tangential_N": [0.2, 0.1]}}, ["load"]),
    ({"load.kind": "rigid"}, ["load"]),
    ({"load.tangential_N": [0.2, 0.1]}, ["load"]),
]


def shaped(place: str, shape: str) -> tuple[Changes, list[str]]:
    """A scene with a shaped table at a place, and the table's key."""
    entry = {"shape": shape, "x_mm": 7.0, "y_mm": 1.0, "rotation_deg": 10.0, **SIZES[shape]}
    load = {"kind": "contact" if shape == "sphere" else "dead"}
    if place == "film.patches[0]":
        return {"film.patches": [entry | LAYER]}, ["film.patches[0]"]
    if place == "electrodes[0]":
        return {"electrodes": [{**entry, "name": "A"}]}, ["electrodes[0]"]
    if place == "electrodes":
        ring = {"layout": "ring", "ring_radius_mm": 8.0, "shape": shape}
        return {"electrodes": ring | SIZES[shape]}, ["electrodes"]
    if place == "probe":
        return {"probe": entry, "load": load}, ["probe"]
    return {"probe": [{**entry, "load": load}]}, ["probe[0]", "probe[0].load"]


FORMS = [(place, form) for place, table in SCENE_TABLES.items() for form in list_forms(table)]
SCENES += [shaped(place, form.fields["shape"].default) for place, form in FORMS if form.shape]


def scaled(value: Any) -> Any:
    """Numbers, or lists of such, by a quarter larger."""
    if isinstance(value, list | tuple):
        return [scaled(one) for one in value]
    if isinstance(value, str):  # a key of a calibration
        return "film.poisson_ratio"
    return type(value)(1.25 * value) or 0.3


def others(table: Section, name: str) -> Iterator[Any]:
    """Other values of a key, by its type and what is said of it; not of tables in it."""
    said, value = table.table_keys[name], getattr(table, name)
    field = TableForm(type(table), type(getattr(table, "geometry", None))).fields[name]
    words = {"shape": PROBE_SHAPES, "profile": PROFILE_ENTRIES, "name": ["Z"], "mains_Hz": [50.0]}
    if value is None:
        yield {} if said.example is None else said.example
    elif isinstance(value, bool):
        yield not value
    elif isinstance(value, str):
        known = [*said.words, *words.get(name, re.findall(r"'([\w -]+)'", str(field.annotation)))]
        yield from (word for word in known if word != value)
    elif not isinstance((*value, 0)[0] if isinstance(value, tuple) else value, Section):
        yield scaled(value)


def changed_alone(changes: Changes, tables: list[str]) -> Iterator[tuple[str, Scene]]:
    """Scenes that differ from that with some changes of `BASE` in one key; those not refused."""
    base = BASE.with_(changes)
    for where in tables:
        table: Any = base
        for step in parse_key(where) if where else ():
            table = table[step] if isinstance(step, int) else getattr(table, step)
        for name in table.table_keys:
            for value in others(table, name):
                try:
                    yield name, base.with_({f"{where}.{name}".lstrip("."): value})
                except SceneError:
                    continue


@cache
def solved(scene: Scene) -> Solution:
    """On a mesh that is the same whatever a key is that moves no outline; not of tips."""
    return solve(scene) if scene.tips else on_mesh(scene)


def films_are_alike(base: Scene, changed: Scene) -> bool:
    """Whether two films deform alike, which electrodes are no part of."""
    first, second = map(solved, (base, changed.model_copy(update={"electrodes": base.electrodes})))
    if base.tips:
        return second.deflection_max_mm == pytest.approx(first.deflection_max_mm, rel=1e-3)
    if not np.array_equal(first.mesh.p, second.mesh.p):
        return False
    found, size = second.displacement, np.abs(first.displacement).max()
    return np.allclose(found, first.displacement, rtol=0.0, atol=1e-9 * size)


def refusal(function: Callable[..., Any], *arguments: Any) -> str:
    """What a function refuses its arguments by; empty where it does not."""
    try:
        function(*arguments)
    except ValueError as error:
        return str(error)
    return ""


@pytest.mark.parametrize(("changes", "tables"), SCENES, ids=lambda value: " ".join(value))
def test_scenes_share_what_a_key_does_not_change(changes, tables):
    """Solves, records of a store, and responses, which name what they are refused by."""
    base, wrong = BASE.with_(changes), []
    has_response = not refusal(require_same_mechanics, base, base)
    for name, changed in changed_alone(changes, tables):
        both = base, changed
        limits = changed.numerics.model_copy(update={"observable": "material"}) == base.numerics
        if not refusal(plan_solves, both) and len(plan_solves(both).blocks) == 1:
            wrong += [name] * (not (limits and films_are_alike(*both)))
        if make_record_key(base) == make_record_key(changed):
            charges = pytest.approx(solved(base).charges_pC, rel=1e-9)
            wrong += [name] * (not (limits and solved(changed).charges_pC == charges))
        if has_response and (told := refusal(require_same_mechanics, *both)):
            wrong += [name] * (name not in told)
        elif has_response and name not in MOVED:
            wrong += [name] * (not films_are_alike(*both))
    assert wrong == []


def test_every_key_is_changed_in_some_scene():
    forms = [TableForm(Scene), *(form for _, form in FORMS)]
    # a scene has the electrodes of a drawing, and none of its keys
    kept = [table for heading, table in TABLES.items() if heading != DRAWN_ELECTRODES]
    forms += [form for table in kept for form in table]
    changed = {name for case in SCENES for name, _ in changed_alone(*case)}
    by_their_keys = {"film", "electrodes", "probe", "load", "numerics", "patches"}
    assert {name for form in forms for name in form.fields} - changed == by_their_keys
