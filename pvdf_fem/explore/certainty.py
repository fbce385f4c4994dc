"""How well noisy readings determine a touch: standard deviations of position and force.

They are computed from the derivatives of the charges at the touch. Other touches with nearly equal
charges are not considered; `pvdf_fem.locate` finds them.
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

#: Ellipses are magnified if none is longer than this fraction of the film's radius.
SMALL_ELLIPSE = 0.02
MAGNIFICATION = 10  #: Factor by which small ellipses are magnified.
#: Names of the quantities of a touch that count as unknown.
UNKNOWN = ("x_mm", "y_mm", "force_N", "depth_mm")


def estimate_certainty(text: str, noise: float) -> dict[str, Any]:
    """Estimate how well readings determine the touch of a scene.

    Parameters
    ----------
    text : str
        Text of the scene file.
    noise : float
        Relative standard deviation of the readings, in addition to the noise of the readout.

    Returns
    -------
    dict
        `message` on the standard deviations, or the reason why there are none; `ellipses` of one
        standard deviation of the position, each a list of points in mm, magnified by
        `MAGNIFICATION` if all are small; `table` of the unknown quantities in HTML. Without
        standard deviations `ellipses` and `table` are empty.
    """
    solution = solve_text(text)
    scene = solution.scene
    values: dict[str, float] = {}
    for key, parameters in map_probe_keys(scene).items():
        _, _, name = parameters[0]
        if name in UNKNOWN:
            values[key] = get_number(scene, key)
    try:
        covariance = _estimate_covariance(solution, values, noise)
    except (NotConvergedError, ValueError) as error:
        return {"message": str(error), "ellipses": [], "table": ""}
    deviations = dict(zip(values, np.sqrt(covariance.diagonal()).tolist(), strict=True))
    touch = {**values, "standard_deviations": deviations, "covariance": covariance}
    ellipses = [compute_deviation_ellipse(touch, key) for key in values if key.endswith("x_mm")]
    largest_mm = max(float(np.ptp(ellipse, axis=0).max()) for ellipse in ellipses)
    is_small = largest_mm <= SMALL_ELLIPSE * 1e3 * scene.film.radius
    message = f"Standard deviations of the touch for readings with {100.0 * noise:g} % noise."
    if is_small:
        message += f" The ellipse is drawn {MAGNIFICATION} times as large."
        ellipses = [_enlarge_ellipse(ellipse) for ellipse in ellipses]
    rows = []
    for key, value in values.items():
        rows.append((_format_key_name(scene, key), f"{value:.4g}", f"{deviations[key]:.2g}"))
    return {
        "message": message,
        "ellipses": [to_point_list(ellipse) for ellipse in ellipses],
        "table": TextTable(("", "value", "standard deviation"), tuple(rows)).to_html(),
    }


def _enlarge_ellipse(ellipse: Array) -> Array:
    """Enlarge an ellipse by `MAGNIFICATION` about its centre.

    The last of its points must repeat the first one, since the centre is the mean of the others.
    """
    centre = ellipse[:-1].mean(axis=0)
    return np.asarray(centre + MAGNIFICATION * (ellipse - centre))


def _estimate_covariance(solution: Solution, values: dict[str, float], noise: float) -> Array:
    """Estimate the covariance of a touch by linearised least squares.

    Parameters
    ----------
    solution : Solution
        The solution at the touch.
    values : dict of str to float
        Unknown quantities of the touch by scene key.
    noise : float
        Relative standard deviation of the readings, in addition to the noise of the readout.

    Returns
    -------
    ndarray, shape (keys, keys)
        The inverse of JᵀJ in the units of the keys. J has the derivatives of the charges with
        respect to the unknown quantities, divided by the standard deviations of the charges.

    Raises
    ------
    ValueError
        If the readings do not determine the touch, if one has no noise, or if changes are read and
        the charges of the unloaded film are not known.
    NotConvergedError
        If the scene has no solution.
    """
    scene = solution.scene
    reads_changes = scene.readout is not None and scene.readout.reading == "change"
    charges_pC = solution.charge_changes_pC if reads_changes else solution.charges_pC
    readings = np.array(list(charges_pC.values()))
    if not np.isfinite(readings).all():
        raise ValueError("changes due to the touch are not known; the warnings say why")
    noise_of_channels_pC = [
        1e12 * channel.noise * channel.capacitance / abs(channel.gain)
        for channel in make_channels(scene)
    ]
    deviations_pC = np.hypot(noise * readings, noise_of_channels_pC)
    if not deviations_pC.all():
        raise ValueError(
            "noise = 0: must be positive, since exact readings have no deviations; raise it"
        )
    rates = gradients(solution, list(values))
    columns = [[rates[key][name] for name in charges_pC] for key in values]
    jacobian = np.array(columns).T / deviations_pC[:, None]
    # The touch is determined if its standard deviation along every direction is at most the film's
    # radius for positions, and the value itself for forces and depths.
    scales = [
        1e3 * scene.film.radius if key.endswith(("x_mm", "y_mm")) else value
        for key, value in values.items()
    ]
    singular_values = np.linalg.svd(jacobian * scales, compute_uv=False)
    if len(readings) < len(values) or singular_values[-1] < 1.0:
        names = ", ".join(_format_key_name(scene, key) for key in values)
        raise ValueError(
            f"{len(readings)} electrodes do not determine {names}; add electrodes, or move them"
        )
    return np.asarray(np.linalg.inv(jacobian.T @ jacobian))


def _format_key_name(scene: Scene, key: str) -> str:
    """Format a scene key in words, with its table in front if this is one of a list."""
    table, _, name = key.rpartition(".")
    title = format_title(find_section(scene, table), name)
    return f"{table} {title}" if "[" in table else title
