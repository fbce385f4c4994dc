"""Scenes that combine features of films, electrodes, probes and loads, and their images.

A feature is a change of a scene by key. A combination that a scene refuses is told by keys.
"""

from __future__ import annotations

import math
from typing import Any

from hypothesis import strategies as st

from pvdf_fem import Scene, SceneError
from pvdf_fem.scene.outlines.outline import turn

Changes = dict[str, Any]

#: Relative error that is wanted of the charges of drawn scenes.
TOLERANCE = 5e-3
POLYGON = [[2.5, -2.0], [2.0, 2.5], [-2.0, 2.0], [-3.0, -1.0]]
PROBES = (
    {"shape": "triangle", "side_mm": 7.0},
    {"shape": "rectangle", "width_mm": 9.0, "height_mm": 5.0},
    {"shape": "circle", "radius_mm": 2.5},
    {"shape": "ellipse", "semi_axes_mm": [4.0, 2.5]},
    {"shape": "polygon", "vertices_mm": POLYGON},
)
LAYOUTS = (
    {"layout": "four"},
    {"layout": "three"},
    {"layout": "ring", "count": 5, "shape": "circle", "radius_mm": 2.0, "ring_radius_mm": 11.0},
    {"layout": "ring", "count": 3, "shape": "square", "side_mm": 3.5, "centre": True},
    [
        {"name": "A", "shape": "polygon", "x_mm": 9.0, "y_mm": 2.0, "vertices_mm": POLYGON},
        {"name": "B", "shape": "rectangle", "x_mm": -8.0, "y_mm": -3.0, "width_mm": 4.0}
        | {"height_mm": 2.0, "rotation_deg": 20.0},
    ],
)
SENSORS: tuple[Changes, ...] = tuple({"electrodes": layout} for layout in LAYOUTS)
FILMS: tuple[Changes, ...] = (
    {"film.youngs_modulus_GPa": [3.0, 1.8], "film.poisson_ratio": 0.3},
    {"film.pretension_N_m": [11.0, 6.0]},
    {"film.pretension_N_m": 5.0},
    {"film.temperature_change_K": 0.0},
    {"film.thickness_um": 110.0, "film.bending": "auto"},
    {"film.thickness_um": 60.0, "film.bending": True},
    {"film.compression": "tension-field"},
    {"film.d31_pC_N": 20.0, "film.d32_pC_N": 3.0},
    {"film.d33_pC_N": -25.0},
    {"film.pyroelectric_uC_m2K": 25.0, "film.warming_K": 0.5},
    {"film.rim_displacement_um": [4.0, 0.0, 1.0, 3.0, -2.0]},
    {"film.patches": [{"shape": "circle", "x_mm": -20.0, "y_mm": 5.0, "radius_mm": 6.0}]},
    {"film.patches": [{"shape": "square", "x_mm": 9.0, "y_mm": 14.0, "side_mm": 8.0}]},
    {"film.pressure_Pa": 150.0, "film.gravity_m_s2": -40.0},
    {"film.pressure_Pa": -80.0, "film.pressure_follows": True},
    {"film.coupling": True, "readout": {"kind": "voltage"}},
    {"film.coupling": "auto", "readout": {"kind": "voltage"}, "film.d31_pC_N": 23.0},
)
LOADS: tuple[Changes, ...] = (
    {"load.kind": "follower"},
    {"load.kind": "rigid"},
    {"load.kind": "rigid", "load.contact": "stuck"},
    {"load.kind": "rigid", "load.tilt": "free"},
    {"load.tangential_N": [0.2, 0.1]},
    {"load.profile": "gaussian"},
    {"load.profile": "gaussian", "load.profile_width_mm": 1.5},
    {"probe.temperature_K": 3.0},
    {"load.kind": "contact", "probe": {"shape": "sphere", "radius_mm": 6.0, "x_mm": 4.0}},
)
READING: tuple[Changes, ...] = (
    {"numerics.observable": "thesis-edge"},
    {"readout": {"kind": "charge", "feedback_capacitance_pF": 1000.0}},
    {"stage": {"x_mm": 1.0, "y_mm": -2.0, "rotation_deg": 10.0}},
    {"air": {"density_kg_m3": 1.2}},
)
SECOND_PROBE = {"shape": "circle", "radius_mm": 2.0, "x_mm": -12.0, "y_mm": -9.0}
PATCH = {"thickness_um": 30.0, "youngs_modulus_GPa": 1.5}


@st.composite
def combinations(draw: st.DrawFn) -> list[Changes]:
    """Changes that make a scene of at least two features, with a probe anywhere near the centre."""
    x, y = draw(st.floats(-9.0, 9.0)), draw(st.floats(-9.0, 9.0))
    place = {"x_mm": x, "y_mm": y, "rotation_deg": draw(st.sampled_from([0.0, 20.0, 135.0]))}
    base: Changes = {"probe": draw(st.sampled_from(PROBES)) | place}
    base["load.force_N"] = draw(st.sampled_from([0.1, 0.7, 2.0]))
    pools = draw(st.lists(st.sampled_from([SENSORS, FILMS, FILMS, LOADS, READING]), min_size=2))
    features = [draw(st.sampled_from(pool)) for pool in pools[:4]]
    if draw(st.integers(0, 3)) == 0:
        own = draw(st.sampled_from([{}, {"force_N": 0.4}, {"load": {"kind": "rigid"}}]))
        features.append({"probe": [base["probe"], SECOND_PROBE | own]})
    return [base, *features]


def combined(changes: list[Changes]) -> Scene | tuple[str, ...]:
    """The scene of some changes, one after the other, or the complaints of its refusal."""
    scene = Scene().with_(**{"numerics.tolerance": TOLERANCE})
    try:
        for change in changes:
            scene = scene.with_(**_of_patches(change))
    except SceneError as error:
        return tuple(error.problems)
    return scene


def _of_patches(change: Changes) -> Changes:
    key = "film.patches"
    return {key: [patch | PATCH for patch in change[key]]} if key in change else change


def quarter_turned(scene: Scene) -> Scene:
    """The scene turned by 90 degrees about its centre."""

    def placed(shape: Changes) -> Changes:
        x, y = turn([shape["x_mm"], shape["y_mm"]], 90.0)
        square = shape["shape"] in ("square", "circle", "sphere") and not shape["rotation_deg"]
        rotation = shape["rotation_deg"] + 90.0 * (not square)
        turned = shape | {"x_mm": x, "y_mm": y, "rotation_deg": rotation}
        return turned | _pushed(shape, lambda x, y: [-y, x])

    def harmonics(c: float, s: float, n: int) -> tuple[float, float]:
        cosine, sine = round(math.cos(0.5 * math.pi * n)), round(math.sin(0.5 * math.pi * n))
        return c * cosine - s * sine, c * sine + s * cosine

    tables = _imaged(scene, placed, harmonics, lambda x, y: [-y, x])
    film = tables["film"]
    film["d31_pC_N"], film["d32_pC_N"] = film["d32_pC_N"], film["d31_pC_N"]
    if isinstance(modulus := film["youngs_modulus_GPa"], list):
        film["poisson_ratio"] *= modulus[1] / modulus[0]
    for key in ("youngs_modulus_GPa", "pretension_N_m"):
        if isinstance(film.get(key), list):
            film[key] = film[key][::-1]
    return Scene(**tables)


def mirrored(scene: Scene) -> Scene:
    """The mirror image of the scene in the y axis."""

    def placed(shape: Changes) -> Changes:
        image = shape | {"x_mm": -shape["x_mm"], "rotation_deg": -shape["rotation_deg"]}
        if "vertices_mm" in shape:
            image["vertices_mm"] = [[-x, y] for x, y in shape["vertices_mm"]]
        return image | _pushed(shape, lambda x, y: [-x, y])

    def harmonics(c: float, s: float, n: int) -> tuple[float, float]:
        return c * (-1) ** n, s * (-1) ** (n + 1)

    return Scene(**_imaged(scene, placed, harmonics, lambda x, y: [-x, y]))


def _pushed(table: Changes, image: Any) -> Changes:
    pushed = table.get("tangential_N")
    return {"tangential_N": image(*pushed)} if pushed else {}


def _imaged(scene: Scene, placed: Any, harmonics: Any, image: Any) -> Changes:
    tables = scene.model_dump(mode="json", exclude_none=True)
    electrodes = [e.model_dump(mode="json", exclude_none=True) for e in scene.electrode_list]
    tables["electrodes"] = [placed(electrode) for electrode in electrodes]
    probe, film = tables["probe"], tables["film"]
    tables["probe"] = [placed(p) for p in probe] if isinstance(probe, list) else placed(probe)
    tables["load"] |= _pushed(tables["load"], image)
    if patches := film.get("patches"):
        film["patches"] = [placed(patch) for patch in patches]
    if moved := film.get("rim_displacement_um"):
        pairs = zip(moved[1::2], moved[2::2], strict=True)
        turned = [harmonics(c, s, n) for n, (c, s) in enumerate(pairs, start=1)]
        film["rim_displacement_um"] = [moved[0], *(value for pair in turned for value in pair)]
    return tables
