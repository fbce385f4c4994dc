"""The spline of a response.

Charges are polynomials of the force, whose coefficients are splines of position and rotation.
"""

from __future__ import annotations

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.progress import TaskRunner
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import Scene
from pvdf_fem.surrogate.stress.stress_modes import StressModes
from pvdf_fem.surrogate.touch_domain import Domain, centre_probe
from pvdf_fem.surrogate.uniform_spline import PADDING_STEPS, UniformAxis, UniformSpline

#: Charges are smooth functions of this power of the force, both for small forces, which the
#: pretension carries, and for large forces, which the additional tension carries.
FORCE_EXPONENT = 1.0 / 6.0


def _compute_scaled_limits(domain: Domain) -> tuple[float, float]:
    """Compute F^(1/6) of the minimum and of the maximum force F in N."""
    lowest, highest = domain.force_N
    return lowest**FORCE_EXPONENT, highest**FORCE_EXPONENT


def compute_force_nodes_N(domain: Domain, count: int) -> Array:
    """Compute a number of forces in N, in descending order, at which charges are interpolated.

    They are the Chebyshev points in F^(1/6) between the minimum and the maximum force F.
    """
    low, high = _compute_scaled_limits(domain)
    points = np.cos((2 * np.arange(count) + 1) * np.pi / (2 * count))
    return (0.5 * (low + high) + 0.5 * (high - low) * points) ** (1.0 / FORCE_EXPONENT)


def evaluate_force_powers(domain: Domain, force_N: Array, count: int) -> Array:
    """Evaluate powers of the scaled force and their derivatives with respect to the force.

    Parameters
    ----------
    domain : Domain
        Domain with the range of forces.
    force_N : ndarray, shape (n,)
        Forces F.
    count : int
        Number of powers 1, t, t², ... of the scaled force t.

    Returns
    -------
    ndarray, shape (n, 2, count)
        Powers, then their derivatives in 1/N.

    Notes
    -----
    The scaled force t is linear in F^(1/6), from -1 at the minimum to 1 at the maximum force.
    """
    low, high = _compute_scaled_limits(domain)
    not_shifted = 2.0 / (high - low) * force_N**FORCE_EXPONENT
    t = not_shifted - (low + high) / (high - low)
    dt_dF = FORCE_EXPONENT * not_shifted / force_N
    powers = np.empty((len(force_N), 2, count))
    powers[:, 0] = np.vander(t, count, increasing=True)
    # The derivative of t^k with respect to the force is k t^(k-1) dt/dF.
    powers[:, 1, 0] = 0.0
    powers[:, 1, 1:] = np.arange(1, count) * dt_dF[:, None] * powers[:, 0, :-1]
    return powers


def estimate_pressed_outline(scene: Scene, force_N: float) -> Outline:
    """Estimate the outline of the area that a probe loads if it is moved to the film's centre.

    This is the outline of the probe itself, or for a tip the estimated outline of its contact.

    Parameters
    ----------
    scene : Scene
        Scene with a single probe.
    force_N : float
        Force, on which the contact of a tip depends. It has no effect for other probes.
    """
    from pvdf_fem.film.loads.contact_estimate import estimate_pressed_area  # imports scikit-fem

    pressed = centre_probe(scene).with_(**{"load.force_N": force_N})
    return estimate_pressed_area(pressed, pressed.loaded_probes[0])[0]


def make_axes(
    scene: Scene, domain: Domain, cell_mm: float, rotation_step: float
) -> tuple[UniformAxis, UniformAxis, UniformAxis]:
    """Make the axes of the spline over position and rotation.

    Parameters
    ----------
    scene : Scene
        Scene with a single probe.
    domain : Domain
        Touches for which the response is valid. The axes of x and y extend beyond its reach by at
        least `PADDING_STEPS` steps.
    cell_mm : float
        Step of x and y.
    rotation_step : float
        Maximum distance that the corners of the probe move between neighbouring rotations, divided
        by `cell_mm`. There are at least 4 rotations, except that a disc has a single one.

    Returns
    -------
    tuple of UniformAxis
        Axes of x and y in mm and of the rotation in degrees.
    """
    assert scene.single_probe is not None
    half = int(np.ceil(domain.reach_mm / cell_mm)) + PADDING_STEPS
    along_x = along_y = UniformAxis(-half * cell_mm, cell_mm, 2 * half + 1)
    period_deg = scene.single_probe.period_deg
    if not period_deg:
        return along_x, along_y, UniformAxis(0.0, 360.0, 1, periodic=True)
    corners_mm = 1e3 * estimate_pressed_outline(scene, domain.force_N[1]).reach
    path_mm = np.radians(period_deg) * corners_mm
    rotations = max(4, int(np.ceil(path_mm / (rotation_step * cell_mm))))
    return along_x, along_y, UniformAxis(0.0, period_deg / rotations, rotations, periodic=True)


def tabulate_charges(
    stress_modes: StressModes,
    scene: Scene,
    domain: Domain,
    axes: tuple[UniformAxis, ...],
    runner: TaskRunner,
) -> UniformSpline:
    """Compute the charges of the electrodes at all nodes of a grid, and fit a spline to them.

    Parameters
    ----------
    stress_modes : StressModes
        Stress about the probe under the forces of `compute_force_nodes_N`.
    scene : Scene
        Scene with the electrodes, d31 and d32.
    domain : Domain
        Domain with the range of forces.
    axes : tuple of UniformAxis
        Axes of x, y and rotation from `make_axes`.
    runner : TaskRunner
        Runner that computes the charges of each rotation as a task, on several processes.

    Returns
    -------
    UniformSpline
        Spline over x, y and rotation. Its functions are the coefficients in pC of the powers of
        `evaluate_force_powers`, ordered by power, then by electrode.
    """
    x_mm, y_mm, rotations_deg = (axis.values for axis in axes)
    positions_mm = np.stack(np.meshgrid(x_mm, y_mm, indexing="ij"), axis=-1).reshape(-1, 2)
    outlines = [electrode.outline for electrode in scene.electrode_list]
    d_pC_N = (scene.film.d31_pC_N, scene.film.d32_pC_N)
    tasks = []
    for rotation in np.radians(rotations_deg):
        compute = stress_modes.compute_charges_pC
        tasks.append((compute, outlines, positions_mm, float(rotation), d_pC_N))
    # shape (positions, rotations, forces, electrodes)
    by_force = np.stack([*runner.run(tasks)], axis=1)
    count = by_force.shape[2]
    forces_N = compute_force_nodes_N(domain, count)
    powers = evaluate_force_powers(domain, forces_N, count)[:, 0]
    # The polynomial in the force through the charges at all forces: convert the charges by force
    # to its coefficients by power.
    by_power = np.einsum("kf,prfe->prke", np.linalg.inv(powers), by_force)
    values = by_power.reshape(len(x_mm), len(y_mm), len(rotations_deg), -1)
    return UniformSpline.interpolate(axes, values, np.float32)
