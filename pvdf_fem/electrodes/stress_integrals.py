"""From a displacement to the two forces of each electrode, and from forces to charges.

A charge is d31 X + d32 Y with the forces X, Y that the electrode's observable makes of the film's
stress; see `pvdf_fem.electrodes.observables`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from skfem import MeshTri2

from pvdf_fem.arrays import COMPLEX_STEP, Array, Selection
from pvdf_fem.electrodes.observables import OBSERVABLES, Observable
from pvdf_fem.electrodes.outputs import Output, output_areas, piezo_coefficients, reflect_outputs
from pvdf_fem.electrodes.sampling import Sampling, place_area_points
from pvdf_fem.film.laws.laminate import Laminate
from pvdf_fem.film.membrane import Membrane
from pvdf_fem.film.space import Space
from pvdf_fem.film.term import State
from pvdf_fem.mesh.symmetry import WHOLE_FILM, SymmetrySector

#: The tolerance of a charge is relative to the charge, or to this share of its parts if larger
#: |d31 X| + |d32 Y|, where they cancel.
CANCELLATION_SHARE = 0.05


@dataclass(frozen=True, eq=False)
class StressIntegrals:
    """Forces of a solution's electrodes, with their estimated errors."""

    values: Array  #: X and Y of each electrode in N, (goals, 2).
    errors: Array  #: Their estimated errors in N, with signs, (goals, 2).

    @classmethod
    def unknown(cls, outputs: int) -> StressIntegrals:
        """NaN for forces and errors at `outputs` electrodes."""
        return cls(np.full((outputs, 2), np.nan), np.full((outputs, 2), np.nan))

    def of(self, rows: Selection | Sequence[int]) -> StressIntegrals:
        """The forces of some electrodes."""
        return StressIntegrals(self.values[rows], self.errors[rows])

    def charges(self, d: ArrayLike) -> Array:
        """Charges d31 X + d32 Y, (goals,), in the units of `d` = d31, d32 times N."""
        return _charges(self.values, d)

    def charge_errors(self, d: ArrayLike, chance: float = 0.5) -> Array:
        """Estimated absolute errors of `charges`, (goals,). The charges share a displacement and
        its error, and an estimate may vanish by chance. So a relative error is at least the part
        `chance` of the mean relative error."""
        errors, parts = np.abs(_charges(self.errors, d)), _charges(np.abs(self.values), np.abs(d))
        total = parts.sum()
        mean = errors.sum() / total if total > 0.0 else 0.0
        return np.asarray(np.maximum(errors, chance * mean * parts))


def compute_stress_integrals(
    outputs: Sequence[Output], membrane: Membrane, x: Array, part: SymmetrySector = WHOLE_FILM
) -> Array:
    """The forces X, Y for every electrode in N, (goals, 2), by a displacement `x` in m."""
    forces = np.zeros((len(outputs), 2))
    for observable, sampling, directions in _samplings(outputs, membrane.space, part):
        film = _sampled(membrane, sampling, part)
        stress = observable.stress(film, sampling.gradient(membrane.space, x))
        integrals = (sampling.weights[..., None] * stress).sum(axis=1)
        for axis in sampling.axes:
            along = (integrals * directions[:, axis]).sum(axis=1)
            forces[:, axis] += np.bincount(sampling.outputs, along, len(outputs))
    if membrane.added is not None:
        forces += integrate_over_outputs(outputs, membrane.added.stress, membrane.space.mesh, part)[
            :, :2
        ]
    for i, output in enumerate(outputs):
        if output.floating is not None:
            forces[i] = output.floating.with_voltage(forces[i])
    return forces


def integrate_over_outputs(
    outputs: Sequence[Output],
    field: Callable[[Array], Array],
    mesh: MeshTri2,
    part: SymmetrySector = WHOLE_FILM,
    degree: int = 19,
) -> Array:
    """Integrals over electrodes, (goals, n), of a field (..., n) at places (..., 2) in the scene's
    axes; exact for polynomials of this degree in every element."""
    images, owners = reflect_outputs(outputs, part)
    rows, _, points, weights = place_area_points(mesh, [image.placed for image in images], degree)
    by_row = (weights[..., None] * field(points @ part.frame)).sum(axis=1)
    total = np.zeros((len(outputs), by_row.shape[-1]))
    np.add.at(total, owners[rows], by_row)
    return total


def differentiate_charges(
    outputs: Sequence[Output], membrane: Membrane, x: Array, part: SymmetrySector = WHOLE_FILM
) -> Array:
    """Derivatives of the electrode charges by the dofs in C/m, (dofs, goals). The parameters are
    those of `compute_stress_integrals`."""
    space, d = membrane.space, np.reshape([output.sensitivity for output in outputs], (-1, 2))
    result = np.zeros((space.dof_count, len(outputs)))
    for observable, sampling, directions in _samplings(outputs, space, part):
        axes = list(sampling.axes)
        weights = (d[sampling.outputs][:, axes, None] * directions[:, axes]).sum(axis=1)
        film = _sampled(membrane, sampling, part)
        gradient = sampling.gradient(space, x)
        slopes = np.empty_like(gradient)
        for entry in np.ndindex(3, 2):
            moved = gradient.astype(complex)
            moved[..., *entry] += 1j * COMPLEX_STEP
            slope = observable.stress(film, moved).imag / COMPLEX_STEP
            slopes[..., *entry] = (slope * weights[:, None]).sum(axis=-1)
        slopes *= sampling.weights[..., None, None]
        local = np.matmul(sampling.gradients, slopes.swapaxes(2, 3)).sum(axis=1)
        dofs = space.element_dofs[sampling.elements]
        np.add.at(result, (dofs, sampling.outputs[:, None]), local.reshape(dofs.shape))
    return result


def combine_charges(outputs: Sequence[Output], forces: Array) -> Array:
    """Charge of each electrode in C, (goals,), from its forces in N, (goals, 2)."""
    return _charges(forces, piezo_coefficients(outputs))


def select_larger_errors(errors: Array, others: Array, outputs: Sequence[Output]) -> Array:
    """The estimate of the force errors (goals, 2) that makes the larger charge error, by goal."""
    first, second = (np.abs(combine_charges(outputs, estimate)) for estimate in (errors, others))
    return np.where((first >= second)[:, None], errors, others)


def distribute_charge_errors(errors: Array, forces: Array, outputs: Sequence[Output]) -> Array:
    """Errors of forces (goals, 2) that add up to the charge errors in C, (goals,)."""
    d = piezo_coefficients(outputs)
    parts = np.abs(d * forces)
    total = parts.sum(axis=1, keepdims=True)
    relative = errors[:, None] / np.where(total > 0.0, total, np.inf)
    return np.asarray(relative * np.abs(forces) * np.sign(d))


def compute_charge_scales(
    outputs: Sequence[Output], state: State, forces: Array, space: Space, negligible: float = 1e-6
) -> Array:
    """Reference sizes in C for relative charge errors, (goals,), from the `forces` X, Y in N. This
    is the charge itself, but at least the part `CANCELLATION_SHARE` of |d31 X| + |d32 Y|. An
    electrode on slack film, or held under a probe, has next to no charge, and a relative error has
    no meaning there. A size is therefore at least the part `negligible` of the charge by the film's
    mean stress."""
    stress = np.abs(state.stress[..., :2]) * space.weights[..., None]
    mean = stress.sum(axis=(0, 1)) / space.weights.sum()
    charges, d = combine_charges(outputs, forces), np.abs(piezo_coefficients(outputs))
    least = np.maximum(
        CANCELLATION_SHARE * _charges(np.abs(forces), d),
        negligible * output_areas(outputs) * (d @ mean),
    )
    sizes = np.maximum(np.abs(charges), least)
    return np.where(sizes > 0.0, sizes, 1.0)


def measure_area_defects(
    outputs: Sequence[Output], space: Space, part: SymmetrySector = WHOLE_FILM
) -> Array:
    """Missing or excess area of the electrodes' curved elements over the electrode areas,
    (goals,)."""
    areas = output_areas(outputs)
    meshed = areas.copy()
    for i, output in enumerate(outputs):
        if output.patch is not None:
            images = output.images(part)
            meshed[i] = sum(space.weights[image.elements(space.mesh)].sum() for image in images)
    return np.abs(meshed / areas - 1.0)


def _charges(forces: Array, d: ArrayLike) -> Array:
    """d31 X + d32 Y for forces (goals, 2), with `d` (2,) for every goal or (goals, 2)."""
    return np.asarray((forces * np.asarray(d)).sum(axis=1))


def _sampled(membrane: Membrane, sampling: Sampling, part: SymmetrySector) -> Laminate:
    """The film at the points; a linear law has one `stress` everywhere."""
    if membrane.added is None or membrane.law.is_linear:
        return membrane
    return membrane.at(sampling.places(membrane.space.mesh) @ part.frame)


def _samplings(
    outputs: Sequence[Output], space: Space, part: SymmetrySector
) -> Iterator[tuple[Observable, Sampling, Array]]:
    """Observables, their sampling points for the stress, and `directions` of their goals."""
    images, owners = reflect_outputs(outputs, part)
    for name, observable in OBSERVABLES.items():
        indices = np.array([i for i, image in enumerate(images) if image.observable == name], int)
        if not len(indices):
            continue
        chosen = [images[i] for i in indices]
        directions = np.stack([image.directions for image in chosen])
        for sampling in observable.samplings(chosen, space):
            of_goals = replace(sampling, outputs=owners[indices[sampling.outputs]])
            yield observable, of_goals, directions[sampling.outputs]
