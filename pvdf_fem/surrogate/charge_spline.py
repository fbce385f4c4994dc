"""The table of a response: polynomials of the force, over a grid of place and rotation."""

from __future__ import annotations

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.progress import TaskRunner
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import Scene
from pvdf_fem.surrogate.stress.stress_modes import StressModes
from pvdf_fem.surrogate.touch_domain import Domain, centre_probe
from pvdf_fem.surrogate.uniform_spline import PADDING_STEPS, UniformAxis, UniformSpline

#: Charges are smooth in this power of the force, both where the pretension carries it and where the
#: tension that it makes itself does.
POWER = 1.0 / 6.0


def compute_force_nodes_N(domain: Domain, count: int) -> Array:
    """Forces at the Chebyshev points of a domain, from the largest to the least."""
    low, high = (limit**POWER for limit in domain.force_N)
    nodes = np.cos((2 * np.arange(count) + 1) * np.pi / (2 * count))
    return (0.5 * (low + high) + 0.5 * (high - low) * nodes) ** (1.0 / POWER)


def evaluate_force_powers(domain: Domain, force_N: Array, count: int) -> Array:
    """Powers 1, t, t² ... of the scaled force t, -1 to 1 over a domain's forces, and their
    derivatives by the force in 1/N, (n, 2, count)."""
    low, high = (limit**POWER for limit in domain.force_N)
    scaled = 2.0 / (high - low) * force_N**POWER
    rate = POWER * scaled / force_N
    powers = np.empty((len(force_N), 2, count))
    powers[:, 0] = np.vander(scaled - (low + high) / (high - low), count, increasing=True)
    powers[:, 1, 0] = 0.0
    powers[:, 1, 1:] = np.arange(1, count) * rate[:, None] * powers[:, 0, :-1]
    return powers


def estimate_pressed_outline(scene: Scene, force_N: float) -> Outline:
    """Outline of a scene's probe at the film's centre, or of the contact that a force makes."""
    from pvdf_fem.film.loads.contact_estimate import estimate_pressed_area  # with scikit-fem

    pressed = centre_probe(scene).with_(**{"load.force_N": force_N})
    return estimate_pressed_area(pressed, pressed.loaded_probes[0])[0]


def make_axes(
    scene: Scene, domain: Domain, cell_mm: float, rotation_step: float
) -> tuple[UniformAxis, ...]:
    """Axes of x and y in mm and of the rotation in degrees, in whose steps the corners of the probe
    move by at most `rotation_step` cells. A disc has one rotation."""
    assert scene.single_probe is not None
    half = int(np.ceil(domain.reach_mm / cell_mm)) + PADDING_STEPS
    across = UniformAxis(-half * cell_mm, cell_mm, 2 * half + 1)
    period, rotations = scene.single_probe.period_deg, 1
    if period:
        way_mm = np.radians(period) * 1e3 * estimate_pressed_outline(scene, domain.force_N[1]).reach
        rotations = max(4, int(np.ceil(way_mm / (rotation_step * cell_mm))))
    return across, across, UniformAxis(0.0, (period or 360.0) / rotations, rotations, periodic=True)


def tabulate_charges(
    stress: StressModes,
    scene: Scene,
    domain: Domain,
    axes: tuple[UniformAxis, ...],
    work: TaskRunner,
) -> UniformSpline:
    """Return the spline of a scene's charges over `make_axes`: coefficients in pC of
    `evaluate_force_powers`, ordered by power, then by electrode."""
    x, y, rotations = (axis.values for axis in axes)
    positions = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    outlines = [electrode.outline for electrode in scene.electrode_list]
    d_pC_N = scene.film.d31_pC_N, scene.film.d32_pC_N
    tasks = [
        (stress.charges_pC, outlines, positions, float(np.radians(rotation)), d_pC_N)
        for rotation in rotations
    ]
    # (x y, rotations, forces, electrodes), then powers of the force
    by_force = np.stack([*work.run(tasks)], axis=1)
    count = by_force.shape[2]
    powers = evaluate_force_powers(domain, compute_force_nodes_N(domain, count), count)[:, 0]
    by_power = np.einsum("kf,prfe->prke", np.linalg.inv(powers), by_force)
    values = by_power.reshape(len(x), len(y), len(rotations), -1)
    return UniformSpline.through(axes, values, np.float32)
