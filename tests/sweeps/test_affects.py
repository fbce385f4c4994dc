"""Every key of a scene, changed alone: sweeps, stores and responses see it, or nothing changes."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from typing import Annotated, Any, NamedTuple, get_args

import numpy as np
import pytest

from pvdf_fem import Response, Scene, SceneError, build_response, solve
from pvdf_fem.mesh.symmetry import part_of
from pvdf_fem.response.build import ResponseOptions
from pvdf_fem.response.response_file import mechanics_of
from pvdf_fem.scene.change import steps_of
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.quantity import Affects, Key, Section
from pvdf_fem.scene.registry import Load
from pvdf_fem.scene.shapes import LISTED_PROBES, MODELS, PROBES
from pvdf_fem.sweeps.plan import plan
from pvdf_fem.sweeps.store import key
from pvdf_fem.sweeps.sweep import solve_all

TOLERANCE = 5e-2
DISC = {"shape": "circle", "radius_mm": 2.5, "x_mm": 2.0, "y_mm": 1.0}
BASE = Scene().with_(
    **{
        "film.radius_mm": 20.0,
        "film.d31_pC_N": 18.0,
        "film.d32_pC_N": 2.0,
        "electrodes.ring_radius_mm": 8.0,
        "probe": DISC,
        "numerics.tolerance": TOLERANCE,
    }
)
SIZES: dict[str, dict[str, Any]] = {
    "circle": {"radius_mm": 2.5},
    "ellipse": {"semi_axes_mm": [3.0, 2.0]},
    "polygon": {"vertices_mm": [[0.0, 0.0], [3.0, 0.0], [0.0, 4.0]]},
    "rectangle": {"width_mm": 3.0, "height_mm": 2.0},
    "sphere": {"radius_mm": 5.0},
    "square": {"side_mm": 3.0},
    "triangle": {"side_mm": 4.0},
}
OTHER = {"shape": "rectangle", "width_mm": 4.0, "height_mm": 3.0}
PATCH = {**DISC, "thickness_um": 30.0}
TIP = {"probe": {**DISC, "shape": "sphere", "radius_mm": 5.0}, "load.kind": "contact"}
WIRED = {"readout": {"kind": "voltage"}}
#: On large electrodes, so that their voltages change charges by more than the tolerance.
COUPLED: dict[str, Any] = {"film.coupling": True, "film.d31_pC_N": 60.0, "film.d32_pC_N": 60.0}
LARGE = {"name": "A", "shape": "circle", "x_mm": 0.0, "y_mm": 0.0, "radius_mm": 15.0}
COUPLED["electrodes"] = [LARGE]
WARM = {"probe.temperature_K": 5.0, "film.pyroelectric_uC_m2K": 20.0}

#: Another value of a key where `another` has none that changes charges, by the key's name, or by
#: its table and name; a table has the values of other keys that the key needs.
SAMPLES: dict[str, Any] = {
    "air": {},
    "bending": True,
    "contact": "stuck",
    "contact_time_s": 10.0,
    "coupling": True,
    "d33_pC_N": -30.0,
    "depth_mm": 0.3,
    "electrodes": [{"name": "A", "x_mm": 3.0, "y_mm": 0.0}],
    "film": {"radius_mm": 22.0},
    "film.density_kg_m3": 5000.0,
    "film.radius_mm": 40.0,
    "film.thermal_expansion_per_K": 500e-6,
    "count": 6,
    "first_angle_deg": 20.0,
    "force_range_N": (0.2, 2.0),
    "gravity_m_s2": 200.0,
    "layout": "three",
    "load": {"kind": "follower", "force_N": 2.0},
    "loss_tangent": 0.1,
    "max_seconds": 20.0,
    "max_unknowns": 100,
    "model": {"reach_mm": 5.0},
    "model.tolerance": 0.05,
    "name": "Z",
    "noise_V": 0.1,
    "numerics": {"tolerance": 0.1},
    "numerics.tolerance": 1e-4,
    "offset_V": 0.3,
    "cable_capacitance_pF": 500.0,
    "patches": [PATCH],
    "permittivity": 200.0,
    "poisson_ratio": 0.1,
    "pressure_Pa": 2000.0,
    "pretension_N_m": 40.0,
    "probe": None,
    "profile": "hertz",
    "profile_width_mm": 1.0,
    "pyroelectric_uC_m2K": 20.0,
    "readout": {"kind": "voltage"},
    "rim_displacement_um": [3.0],
    "ring_radius_mm": 10.0,
    "rotation_deg": 25.0,
    "shape": OTHER,
    "shear_modulus_GPa": 3.0,
    "side_mm": 4.5,
    "stage": {"x_mm": 3.0},
    "tangential_N": [0.2, 0.0],
    "temperature_change_K": -5.0,
    "temperature_K": 5.0,
    "thermal_diffusivity_m2_s": 1e-6,
    "vertices_mm": [[0.0, 0.0], [3.0, 0.0], [0.0, 2.0]],
    "warming_K": 0.4,
    "width_mm": 4.5,
    "semi_axes_mm": [3.2, 1.0],
    "x_mm": 4.0,
    "y_mm": 3.5,
}
#: Changes of the base scene without which a key is refused, or with which the key may act.
BASES: dict[str, list[dict[str, Any]]] = {
    "film.compression": [{}, {"film.temperature_change_K": 0.05}],
    "film.coupling": [{}, {**COUPLED, **WIRED, "film.coupling": False}],
    "film.d33_pC_N": [{}, {"film.d33_pC_N": -10.0, "probe.x_mm": 7.0}],
    "film.density_kg_m3": [{}, WARM, {"film.gravity_m_s2": 20.0}],
    "film.patches": [{}, {"film.patches": [{**PATCH, "thickness_um": 60.0}]}],
    "film.permittivity": [{}, {**COUPLED, **WIRED}],
    "film.pyroelectric_uC_m2K": [{}, {**WARM, "film.pyroelectric_uC_m2K": 5.0}],
    "film.gravity_m_s2": [{}, {"film.gravity_m_s2": 20.0}],
    "film.pressure_Pa": [{}, {"film.pressure_Pa": 10.0}],
    "film.pressure_follows": [{"film.pressure_Pa": 2000.0}],
    "film.rim_displacement_um": [{}, {"film.rim_displacement_um": [1.0]}],
    "film.shear_modulus_GPa": [{}, {"film.shear_modulus_GPa": 1.0}],
    "film.thermal_diffusivity_m2_s": [WARM],
    "load.contact": [{"load.kind": "rigid"}],
    "load.depth_mm": [TIP],
    "load.profile": [{}, {"load.profile": "gaussian", "load.profile_width_mm": 1.0}],
    "load.profile_width_mm": [{"load.profile": "gaussian"}],
    "load.tangential_N": [{}, {"load.tangential_N": [0.0, 0.2]}],
    "load.tilt": [{"load.kind": "rigid"}],
    "probe.circle.edge_radius_mm": [{"load.kind": "contact", "probe.edge_radius_mm": 2.0}],
    "readout": [{}, {**COUPLED, "readout": {"kind": "charge"}}],
    "readout.cable_capacitance_pF": [WIRED, {**COUPLED, **WIRED}],
    "readout.input_resistance_MOhm": [WIRED],
    "readout.kind": [{}, COUPLED],
}
#: What keys need in their own table.
NEEDS: dict[str, dict[str, Any]] = {
    "contact": {"kind": "rigid"},
    "contact_time_s": {"temperature_K": 5.0},
    "depth_mm": {"kind": "contact"},
    "tilt": {"kind": "rigid"},
    "film.patches[0].poisson_ratio": {"youngs_modulus_GPa": 2.0},
    "film.patches[0].thermal_expansion_per_K": {"bonded": "before stretching"},
}


class Place(NamedTuple):
    """A table of scenes, its model, and changes of `BASE` without which there is none."""

    name: str
    table: str
    model: type[Section]
    changes: dict[str, Any]


def places() -> Iterator[Place]:
    """All tables that scenes may have, by the models."""
    for name, field in Scene.model_fields.items():
        for model in (field.annotation, *get_args(field.annotation)):
            if isinstance(model, type) and issubclass(model, Section):
                yield Place(name, name, model, {name: {}} if field.default is None else {})
    for path, model in MODELS.items():
        name, shape = ".".join(path), path[2] if path[2:] else ""
        entry = {"shape": shape, "x_mm": 2.0, "y_mm": 1.0, **SIZES.get(shape, {})}
        kind = {"load.kind": "contact"} if shape == "sphere" else {}
        match path:
            case ("electrodes", "table", _):
                ring = {"layout": "ring", "ring_radius_mm": 8.0, "shape": shape, **SIZES[shape]}
                yield Place(name, "electrodes", model, {"electrodes": ring})
            case ("electrodes", "list", _):
                yield Place(name, "electrodes[0]", model, {"electrodes": [{**entry, "name": "A"}]})
            case ("film", "patches", _):
                patches = [{**entry, "x_mm": 7.0, "thickness_um": 30.0}]
                yield Place(name, "film.patches[0]", model, {"film.patches": patches})
            case ("probe", "table", _):
                yield Place(f"probe.{shape}", "probe", model, {"probe": entry, **kind})
            case ("probe", "list", _):
                yield Place(name, "probe[0]", model, {"probe": [entry], **kind})
            case ("probe", "list", _, "load"):
                load = {"kind": kind.get("load.kind", "dead")}
                yield Place(name, "probe[0].load", model, {"probe": [{**entry, "load": load}]})
            case _:
                pytest.fail(f"{name}: say how scenes have such a table")


def pairs() -> Iterator[Any]:
    """A case for each key of each table: the key, and the changes of the base scene and of it."""
    found = [(name, name, {}) for name in Scene.model_fields]
    for place in places():
        keys = place.model.model_fields
        found += [(f"{place.name}.{key}", f"{place.table}.{key}", place.changes) for key in keys]
    for name, key_, changes in found:
        for base in BASES.get(name, [{}]):
            yield pytest.param(key_, {**changes, **base}, name, id=f"{name} {[*base]}")


CASES = list(pairs())


def another(model: type[Section], name: str, value: Any) -> Any:
    """Another value of a key, by its type and what is said of it."""
    said = model.key_of(name)
    words = [*said.words, *re.findall(r"'([\w -]+)'", str(model.model_fields[name].annotation))]
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float) and value:
        return type(value)(1.25 * value)
    return next((word for word in (*words, said.example) if word not in (None, value)), ...)


def changed_alone(base: Scene, key_: str, name: str) -> Scene:
    """The scene with another value of a key."""
    table, _, short = key_.rpartition(".")
    sample = SAMPLES.get(name, SAMPLES.get(short, ...))
    if sample is ...:
        within = base
        for step in steps_of(table):
            within = within[step] if isinstance(step, int) else getattr(within, step)
        sample = another(type(within), short, getattr(within, short))
    if sample is ...:
        pytest.fail(f"{name}: has no other value; give its Key an example, or give a sample")
    if isinstance(sample, dict) and table:
        return base.with_(**{f"{table}.{each}": value for each, value in sample.items()})
    return base.with_(**{key_: sample})


def scenes_of(key_: str, changes: dict[str, Any], name: str) -> tuple[Scene, Scene] | None:
    """A scene, and the scene with another value of a key; None where the key is refused."""
    table, _, short = key_.rpartition(".")
    needed = NEEDS.get(key_, NEEDS.get(short, {}))
    changes = {**changes, **{f"{table}.{each}": value for each, value in needed.items()}}
    try:
        base = BASE.with_(**changes)
        return base, changed_alone(base, key_, name)
    except SceneError:
        return None


@cache
def charges_of(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Charges in pC by a solve of their own, and their errors, (electrodes,)."""
    solution = solve(scene)
    errors = solution.charge_errors_pC
    return np.array([*solution.charges_pC.values()]), np.array([*errors.values()])


def assert_fresh(scene: Scene, charges_pC: Any, errors_pC: Any = 0.0) -> None:
    """Charges (electrodes,) with these errors are those of a solve of the scene alone."""
    fresh, errors = charges_of(scene)
    allowed = errors + errors_pC + 1e-3 * np.abs(fresh).max()
    assert (np.abs(np.array([*charges_pC]) - fresh) <= allowed).all()


@pytest.mark.parametrize(("key_", "changes", "name"), CASES)
def test_a_key_that_is_changed_alone_shares_what_it_does_not_change(key_, changes, name):
    if (scenes := scenes_of(key_, changes, name)) is None:
        return
    base, changed = scenes
    assert changed != base
    try:
        shared = len(plan(scenes).blocks) == 1
    except SceneError:  # refused by key
        shared = False
    if shared:
        for scene, record in zip(scenes, solve_all(scenes, processes=1), strict=True):
            reads = scene.film.d31_pC_N, scene.film.d32_pC_N, scene.numerics.observable
            found, errors = record.charges_pC(*reads), record.charge_errors_pC(*reads)
            assert [*found] == [electrode.name for electrode in scene.electrode_list]
            sizes = np.abs([*found.values()])
            assert (np.array([*errors.values()]) <= scene.numerics.tolerance * sizes).all()
            assert_fresh(scene, found.values(), np.array([*errors.values()]))
    if key(base) == key(changed):
        assert_fresh(base, charges_of(changed)[0])


def test_every_key_is_tried_in_some_table():
    tried, names = set(), set()
    for case in CASES:
        key_, changes, name = case.values
        names.add(name.rpartition(".")[2])
        if scenes_of(key_, changes, name):
            tried.add(name.rpartition(".")[2])
    assert names == tried


@pytest.fixture(scope="module")
def response() -> Response:
    coarse = ResponseOptions(error=5e-2, held_out=2, attempts=1)
    return build_response(BASE, 4.0, (0.5, 3.0), 0.2, 1, options=coarse)


@pytest.mark.parametrize(
    ("key_", "changes", "name"),
    [case for case in CASES if set(case.values[1]) <= {"readout", "stage", "air"}],
)
def test_a_response_of_a_scene_is_refused_or_right(response, key_, changes, name):
    scenes = scenes_of(key_, changes, name)
    assert scenes is not None
    try:
        made = response.for_scene(scenes[1], 1)
    except ValueError as error:
        refused = str(error)
    else:
        refused = ""
    if refused:
        assert name.partition(".")[0] in refused
        return
    touched = scenes[1].model_copy(update={"numerics": BASE.numerics})
    probe, force = touched.single_probe, touched.load.force_N
    found, _ = made.evaluate([[probe.x_mm, probe.y_mm, probe.rotation_deg, force]])
    assert_fresh(touched, found[0], made.error_bound * charges_of(touched)[0])


class CoatedFilm(Film):
    """A film with keys that are new."""

    coating_um: float = 0.0
    shade: Annotated[float, Key(affects=Affects.READING)] = 0.0


class CoatedProbe(PROBES["circle"]):
    """A probe with a key that is new."""

    coating_um: float = 0.0


@pytest.fixture(scope="module")
def coated() -> Scene:
    with pytest.warns(UserWarning, match="shadows an attribute"):

        class CoatedScene(Scene):
            """A scene with a key that is new, and a film that has some."""

            film: CoatedFilm = CoatedFilm()
            load: Load = Load()
            coating_um: float = 0.0

    return CoatedScene(probe=DISC)


@pytest.mark.parametrize(
    ("new_key", "solves"), [("film.coating_um", 2), ("coating_um", 2), ("film.shade", 1)]
)
def test_a_new_key_counts_unless_it_says_what_it_affects(coated, new_key, solves):
    changed = coated.with_(**{new_key: 1.0})
    assert len(plan([coated, changed]).blocks) == solves
    assert len({mechanics_of(coated), mechanics_of(changed)}) == solves
    assert key(coated) != key(changed)


def test_a_new_key_of_a_shape_counts():
    scenes = [
        BASE.model_copy(update={"probe": CoatedProbe(**DISC, coating_um=um)}) for um in (0, 1)
    ]
    assert len(plan(scenes).blocks) == 2
    assert key(scenes[0]) != key(scenes[1])


def test_a_new_key_of_probes_counts_for_the_symmetry_of_a_scene():
    class CoatedPress(LISTED_PROBES["circle"]):
        """A probe of a list with a key that is new."""

        coating_um: float = 0.0

    def part(*coatings_um: float) -> tuple[int, ...]:
        places = zip((-5.0, 5.0), coatings_um, strict=True)
        probes = tuple(CoatedPress(x_mm=x, radius_mm=2.5, coating_um=um) for x, um in places)
        return part_of(BASE.model_copy(update={"probe": probes})).mirrored

    assert len(part(1.0, 1.0)) == 2
    assert len(part(0.0, 1.0)) == 1
