"""How well noisy readings tell the touch of a solution: its place and force, with ellipses.

The deviations follow from the derivatives of the charges at the touch, in a moment. Other touches
with nearly equal charges are not searched for; `pvdf_fem.locate` finds them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.channel import make_channels
from pvdf_fem.explore.controls import find_section, format_title, to_point_list
from pvdf_fem.explore.picture import solve_text
from pvdf_fem.scene.changes import get_number
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.nonlinear.status import NotConvergedError
from pvdf_fem.solver.sensitivity.gradients import gradients
from pvdf_fem.solver.sensitivity.parameters import map_probe_keys
from pvdf_fem.solver.solution import Solution
from pvdf_fem.summary import TextTable
from pvdf_fem.view.touch_map import compute_deviation_ellipse

#: Smaller ellipses, over the film's radius, are drawn this many times as large.
LEAST_SIZE, MAGNIFIED = 0.02, 10
SOUGHT = ("x_mm", "y_mm", "force_N", "depth_mm")


def estimate_certainty(text: str, noise: float) -> dict[str, Any]:
    """Ellipses of one standard deviation and a table of the touch of a scene file, or the reason
    why there are none. `noise` is the standard deviation of readings, relative to them, to which
    the readout's is added."""
    solution = solve_text(text)
    keys = [
        key for key, ((_, _, name), *_) in map_probe_keys(solution.scene).items() if name in SOUGHT
    ]
    values = {key: get_number(solution.scene, key) for key in keys}
    try:
        covariance = _covariance(solution, values, noise)
    except (NotConvergedError, ValueError) as error:
        return {"told": str(error), "ellipses": [], "table": ""}
    deviations = dict(zip(keys, np.sqrt(covariance.diagonal()).tolist(), strict=True))
    touch = {**values, "standard_deviations": deviations, "covariance": covariance}
    ellipses = [compute_deviation_ellipse(touch, key) for key in keys if key.endswith("x_mm")]
    seen = max(float(np.ptp(ellipse, axis=0).max()) for ellipse in ellipses)
    times = 1 if seen > LEAST_SIZE * solution.scene.film.radius_mm else MAGNIFIED
    rows = [
        (_title(solution.scene, key), f"{values[key]:.4g}", f"{deviations[key]:.2g}")
        for key in keys
    ]
    told = f"Readings with {100.0 * noise:g} % noise tell the touch to these standard deviations."
    told += f" The ellipse is drawn {times} times as large." if times > 1 else ""
    centres = [ellipse[:-1].mean(axis=0) for ellipse in ellipses]
    drawn = [to_point_list(at + times * (e - at)) for e, at in zip(ellipses, centres, strict=True)]
    table = TextTable(("", "value", "standard deviation"), (*rows,)).to_html()
    return {"told": told, "ellipses": drawn, "table": table}


def _covariance(solution: Solution, values: dict[str, float], noise: float) -> Array:
    """Covariance of a touch, (keys, keys); ValueError where the readings do not tell it."""
    scene = solution.scene
    changes = scene.readout is not None and scene.readout.reading == "change"
    read = solution.charge_changes_pC if changes else solution.charges_pC
    if not np.isfinite([*read.values()]).all():
        raise ValueError("changes by the touch are not known; the warnings say why")
    own = [1e12 * c.noise * c.capacitance / abs(c.gain) for c in make_channels(scene)]
    spread = np.hypot(noise * np.array([*read.values()]), own)
    if not spread.all():
        raise ValueError("noise = 0: readings without noise tell everything; give some noise")
    rates = gradients(solution, [*values])
    slopes = np.array([[rates[key][name] for key in values] for name in read]) / spread[:, None]
    # a touch is told if each of its deviations is less than the film's radius, or than its force
    radius, places = scene.film.radius_mm, ("x_mm", "y_mm")
    extents = [radius if key.endswith(places) else size for key, size in values.items()]
    sizes = np.linalg.svd(slopes * extents, compute_uv=False)
    if len(read) < len(values) or sizes[-1] < 1.0:
        names = ", ".join(_title(scene, key) for key in values)
        raise ValueError(f"{len(read)} electrodes do not tell {names}; give more, or move them")
    return np.asarray(np.linalg.inv(slopes.T @ slopes))


def _title(scene: Scene, key: str) -> str:
    """The name of a key in words, of one of several probes with its number."""
    table, _, name = key.rpartition(".")
    number = f"{table} " if "[" in table else ""
    return f"{number}{format_title(find_section(scene, table), name)}"
