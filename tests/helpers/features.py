"""Scenes that combine features of films, electrodes, probes and loads, and their images.

A feature is a change of a scene by key. A combination that a scene refuses is told by keys.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import strategies as st

from pvdf_fem import Scene, SceneError

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
PATCH = {"thickness_um": 30.0, "youngs_modulus_GPa": 1.5}
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
    {"film.patches": [{**PATCH, "shape": "circle", "x_mm": -20.0, "y_mm": 5.0, "radius_mm": 6.0}]},
    {"film.patches": [{**PATCH, "x_mm": 9.0, "y_mm": 14.0, "side_mm": 8.0}]},
    {"film.pressure_Pa": 150.0, "film.gravity_m_s2": -40.0},
    {"film.pressure_Pa": -80.0, "film.pressure_follows": True},
    {"film.backing_N_m3": 3e4},
    {"film.backing_N_m3": 5e4, "film.backing_one_sided": True},
    {"film.patches": [{"x_mm": -9.0, "y_mm": 4.0, "side_mm": 12.0, "backing_N_m3": 2e5}]},
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
    {"load.kind": "contact", "probe": {"shape": "sphere", "radius_mm": 5.0, "x_mm": 5.0}}
    | {"load.depth_mm": 0.3},
)
READING: tuple[Changes, ...] = (
    {"numerics.observable": "thesis-edge"},
    {"readout": {"kind": "charge", "feedback_capacitance_pF": 1000.0}},
    {"stage": {"x_mm": 1.0, "y_mm": -2.0, "rotation_deg": 10.0}},
    {"air": {"density_kg_m3": 1.2}},
)
SECOND_PROBE = {"shape": "circle", "radius_mm": 2.0, "x_mm": -12.0, "y_mm": -9.0}


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
            scene = scene.with_(**change)
    except SceneError as error:
        return tuple(error.problems)
    return scene


#: Maps of the plane, as matrices: a quarter turn, and the mirror image in the y axis.
QUARTER_TURN, MIRROR = ((0.0, -1.0), (1.0, 0.0)), ((-1.0, 0.0), (0.0, 1.0))


def image(scene: Scene, frame: tuple[tuple[float, float], ...]) -> Scene:
    """The scene after a map of the plane that brings its axes onto each other."""
    tables = scene.model_dump(mode="json", exclude_none=True)
    film, probe, matrix = tables["film"], tables["probe"], np.array(frame)
    mirrors, swaps = np.linalg.det(matrix) < 0.0, matrix[0, 0] == 0.0

    def mapped(vector: list[float]) -> list[float]:
        return (matrix @ vector + 0.0).tolist()

    def pushed(table: Changes) -> Changes:
        force = table.get("tangential_N")
        return {"tangential_N": mapped(force)} if force else {}

    def placed(shape: Changes) -> Changes:
        x, y = mapped([shape["x_mm"], shape["y_mm"]])
        turned = -shape["rotation_deg"] if mirrors else shape["rotation_deg"] + 90.0
        if shape["shape"] in ("square", "circle", "sphere") and not shape["rotation_deg"]:
            turned = 0.0  # the thesis's means are of upright squares
        found = shape | {"x_mm": x, "y_mm": y, "rotation_deg": turned} | pushed(shape)
        if mirrors and "vertices_mm" in shape:
            found["vertices_mm"] = [mapped(corner) for corner in shape["vertices_mm"]]
        return found

    electrodes = [e.model_dump(mode="json", exclude_none=True) for e in scene.electrode_list]
    tables["electrodes"] = [placed(electrode) for electrode in electrodes]
    tables["probe"] = [placed(p) for p in probe] if isinstance(probe, list) else placed(probe)
    tables["load"] |= pushed(tables["load"])
    if patches := film.get("patches"):
        film["patches"] = [placed(patch) for patch in patches]
    if moved := film.get("rim_displacement_um"):
        # Re C z^n of the angle's z = exp(it), with C = c - i s
        waves = [complex(c, -s) for c, s in zip(moved[1::2], moved[2::2], strict=True)]
        at = complex(*matrix[:, 0])
        images = [(w.conjugate() if mirrors else w) * at**-n for n, w in enumerate(waves, 1)]
        film["rim_displacement_um"] = [moved[0], *(x for w in images for x in (w.real, -w.imag))]
    if swaps:
        film["d31_pC_N"], film["d32_pC_N"] = film["d32_pC_N"], film["d31_pC_N"]
        if isinstance(modulus := film["youngs_modulus_GPa"], list):
            film["poisson_ratio"] *= modulus[1] / modulus[0]
        for key in ("youngs_modulus_GPa", "pretension_N_m"):
            if isinstance(film.get(key), list):
                film[key] = film[key][::-1]
    return Scene(**tables)
