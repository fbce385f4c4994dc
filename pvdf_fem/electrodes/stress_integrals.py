"""Stress integrals of the electrodes, and the charges that follow from them.

A charge is d31 X + d32 Y with the stress integrals X = ∫ S11 dA and Y = ∫ S22 dA over the
electrode, or with other integrals that its observable defines; see
`pvdf_fem.electrodes.observables`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from skfem import MeshTri2

from pvdf_fem.arrays import COMPLEX_STEP, Array, Selection
from pvdf_fem.electrodes.observables import OBSERVABLES, Observable
from pvdf_fem.electrodes.sampling import Sampling, place_area_points
from pvdf_fem.film.laws.laminate import Laminate
from pvdf_fem.film.membrane import Membrane
from pvdf_fem.film.space import Space
from pvdf_fem.film.term import State
from pvdf_fem.mesh.symmetry import WHOLE_FILM, SymmetrySector
from pvdf_fem.problem.outputs import (
    Output,
    compute_output_areas,
    get_piezo_coefficients,
    reflect_outputs,
)

#: The tolerance of a charge is relative to the charge, or to this fraction of |d31 X| + |d32 Y|
#: if d31 X and d32 Y nearly cancel.
CANCELLATION_FRACTION = 0.05


@dataclass(frozen=True, eq=False)
class StressIntegrals:
    """Stress integrals X and Y of a solution's outputs, with their estimated errors."""

    values: Array  #: X and Y of each output in N, shape (outputs, 2).
    errors: Array  #: Estimated errors of X and Y in N, with signs, shape (outputs, 2).

    @classmethod
    def unknown(cls, outputs: int) -> StressIntegrals:
        """Make the result for a number of outputs without a solution: all entries are NaN."""
        return cls(np.full((outputs, 2), np.nan), np.full((outputs, 2), np.nan))

    def of(self, rows: Selection | Sequence[int]) -> StressIntegrals:
        """Return the stress integrals of the outputs with the indices `rows`."""
        return StressIntegrals(self.values[rows], self.errors[rows])

    def charges(self, d: ArrayLike) -> Array:
        """Compute the charges d31 X + d32 Y.

        Parameters
        ----------
        d : array_like, shape (2,) or (outputs, 2)
            d31 and d32, for all outputs or for each.

        Returns
        -------
        ndarray, shape (outputs,)
            Charges in the unit of `d` times N.
        """
        return _combine_stress_integrals(self.values, d)

    def charge_errors(self, d: ArrayLike, min_fraction: float = 0.5) -> Array:
        """Compute the estimated absolute errors of `charges`.

        All charges follow from one displacement with one error, and a single estimate may vanish by
        chance. Therefore the error of each output relative to |d31 X| + |d32 Y| is at least a
        fraction of the mean over all outputs.

        Parameters
        ----------
        d : array_like, shape (2,) or (outputs, 2)
            d31 and d32, for all outputs or for each.
        min_fraction : float, optional
            Minimum relative error, as a fraction of the mean relative error.

        Returns
        -------
        ndarray, shape (outputs,)
            Errors in the unit of `d` times N.
        """
        errors = np.abs(_combine_stress_integrals(self.errors, d))
        magnitudes = _combine_stress_integrals(np.abs(self.values), np.abs(d))
        total = magnitudes.sum()
        mean = errors.sum() / total if total > 0.0 else 0.0
        return np.asarray(np.maximum(errors, min_fraction * mean * magnitudes))


def compute_stress_integrals(
    outputs: Sequence[Output],
    membrane: Membrane,
    x: Array,
    *,
    sector: SymmetrySector = WHOLE_FILM,
) -> Array:
    """Compute the stress integrals X and Y of electrodes from a displacement.

    Parameters
    ----------
    outputs : sequence of Output
        Electrodes on the whole film; on a sector their reflections are summed.
    membrane : Membrane
        The membrane term, with its finite-element space.
    x : ndarray, shape (dofs,)
        Displacement in m.
    sector : SymmetrySector, optional
        The sector that the space covers.

    Returns
    -------
    ndarray, shape (outputs, 2)
        X and Y in N. For a floating electrode they include the stress due to its own voltage.
    """
    integrals = np.zeros((len(outputs), 2))
    for observable, sampling, directions in _iterate_samplings(outputs, membrane.space, sector):
        film = _select_film_for_samples(membrane, sampling, sector)
        stress = observable.stress(film, sampling.gradient(membrane.space, x))
        by_row = (sampling.weights[..., None] * stress).sum(axis=1)
        for axis in sampling.axes:
            along = (by_row * directions[:, axis]).sum(axis=1)
            integrals[:, axis] += np.bincount(sampling.outputs, along, len(outputs))
    if membrane.added is not None:
        added = integrate_over_outputs(outputs, membrane.added.stress, membrane.space.mesh, sector)
        integrals += added[:, :2]
    for i, output in enumerate(outputs):
        if output.floating is not None:
            integrals[i] = output.floating.with_voltage(integrals[i])
    return integrals


def integrate_over_outputs(
    outputs: Sequence[Output],
    field: Callable[[Array], Array],
    mesh: MeshTri2,
    sector: SymmetrySector = WHOLE_FILM,
    *,
    degree: int = 19,
) -> Array:
    """Integrate a field over the areas of electrodes.

    On a sector the integral of an electrode is the sum over its reflections. The field is evaluated
    at points of the sector only, so that it must have the symmetry of the sector.

    Parameters
    ----------
    outputs : sequence of Output
        Electrodes on the whole film.
    field : callable
        Function that returns values (..., n) at points (..., 2) in m, in the scene's axes.
    mesh : MeshTri2
        Mesh of the sector, which need not follow the electrodes.
    sector : SymmetrySector, optional
        The sector that is meshed.
    degree : int, optional
        Polynomial degree up to which the integral is exact in every element.

    Returns
    -------
    ndarray, shape (outputs, n)
    """
    reflections, owners = reflect_outputs(outputs, sector)
    outlines = [reflection.placed for reflection in reflections]
    area = place_area_points(mesh, outlines, degree)
    values = field(area.points @ sector.frame)
    by_row = (area.weights[..., None] * values).sum(axis=1)
    integrals = np.zeros((len(outputs), by_row.shape[-1]))
    np.add.at(integrals, owners[area.owners], by_row)
    return integrals


def differentiate_charges(
    outputs: Sequence[Output],
    membrane: Membrane,
    x: Array,
    *,
    sector: SymmetrySector = WHOLE_FILM,
) -> Array:
    """Differentiate the charges of electrodes with respect to the displacement dofs.

    The stress of an observable is differentiated by a complex step.

    Parameters
    ----------
    outputs : sequence of Output
        Electrodes on the whole film; on a sector their reflections are summed.
    membrane : Membrane
        The membrane term, with its finite-element space.
    x : ndarray, shape (dofs,)
        Displacement in m at which the derivatives are taken.
    sector : SymmetrySector, optional
        The sector that the space covers.

    Returns
    -------
    ndarray, shape (dofs, outputs)
        Derivatives in C/m.
    """
    space = membrane.space
    coefficients = np.reshape([output.charge_coefficients for output in outputs], (-1, 2))
    derivatives = np.zeros((space.dof_count, len(outputs)))
    for observable, sampling, directions in _iterate_samplings(outputs, space, sector):
        axes = list(sampling.axes)
        d = coefficients[sampling.outputs][:, axes, None]
        weights = (d * directions[:, axes]).sum(axis=1)
        film = _select_film_for_samples(membrane, sampling, sector)
        gradient = sampling.gradient(space, x)
        slopes = np.empty_like(gradient)
        for entry in np.ndindex(3, 2):
            stepped = gradient.astype(complex)
            stepped[..., *entry] += 1j * COMPLEX_STEP
            slope = observable.stress(film, stepped).imag / COMPLEX_STEP
            slopes[..., *entry] = (slope * weights[:, None]).sum(axis=-1)
        slopes *= sampling.weights[..., None, None]
        local = np.matmul(sampling.gradients, slopes.swapaxes(2, 3)).sum(axis=1)
        dofs = space.element_dofs[sampling.elements]
        np.add.at(derivatives, (dofs, sampling.outputs[:, None]), local.reshape(dofs.shape))
    return derivatives


def combine_charges(outputs: Sequence[Output], integrals: Array) -> Array:
    """Compute the charges d31 X + d32 Y in C from stress integrals.

    Parameters
    ----------
    outputs : sequence of Output
        The electrodes, which give d31 and d32.
    integrals : ndarray, shape (outputs, 2)
        X and Y in N.

    Returns
    -------
    ndarray, shape (outputs,)
    """
    return _combine_stress_integrals(integrals, get_piezo_coefficients(outputs))


def select_larger_errors(errors: Array, others: Array, outputs: Sequence[Output]) -> Array:
    """Select, for each output, the error estimate with the larger absolute charge error.

    Parameters
    ----------
    errors, others : ndarray, shape (outputs, 2)
        Two estimates of the errors of the stress integrals in N; `errors` is selected if their
        charge errors are equal.
    outputs : sequence of Output
        The electrodes, which give d31 and d32.

    Returns
    -------
    ndarray, shape (outputs, 2)
    """
    charge_errors = np.abs(combine_charges(outputs, errors))
    other_charge_errors = np.abs(combine_charges(outputs, others))
    is_larger = charge_errors >= other_charge_errors
    return np.where(is_larger[:, None], errors, others)


def distribute_charge_errors(errors: Array, integrals: Array, outputs: Sequence[Output]) -> Array:
    """Distribute charge errors to X and Y, in proportion to |d31 X| and |d32 Y|.

    Parameters
    ----------
    errors : ndarray, shape (outputs,)
        Absolute charge errors in C.
    integrals : ndarray, shape (outputs, 2)
        Stress integrals in N.
    outputs : sequence of Output
        The electrodes, which give d31 and d32.

    Returns
    -------
    ndarray, shape (outputs, 2)
        Errors of X and Y in N, with the signs of d31 and d32, so that `combine_charges` gives the
        charge errors. Zero for an output without stress.
    """
    d = get_piezo_coefficients(outputs)
    total = np.abs(d * integrals).sum(axis=1, keepdims=True)
    relative = errors[:, None] / np.where(total > 0.0, total, np.inf)
    return np.asarray(relative * np.abs(integrals) * np.sign(d))


def compute_charge_scales(
    outputs: Sequence[Output],
    state: State,
    integrals: Array,
    space: Space,
    *,
    negligible: float = 1e-6,
) -> Array:
    """Compute the positive charges to which charge errors are relative.

    The scale of an output is its absolute charge, but at least the fraction `CANCELLATION_FRACTION`
    of |d31 X| + |d32 Y|. An electrode on slack film, or under a rigid probe, has almost no charge,
    for which a relative error has no meaning. Therefore a scale is also at least the fraction
    `negligible` of the charge that the film's mean stress would cause.

    Parameters
    ----------
    outputs : sequence of Output
        The electrodes, which give areas, d31 and d32.
    state : State
        The solution, which gives the mean stress.
    integrals : ndarray, shape (outputs, 2)
        Stress integrals in N.
    space : Space
        The finite-element space.
    negligible : float, optional
        Minimum scale, as a fraction of the charge that the mean stress would cause.

    Returns
    -------
    ndarray, shape (outputs,)
        Scales in C; 1 if all of these charges are zero.
    """
    stress = np.abs(state.stress[..., :2]) * space.weights[..., None]
    mean_stress = stress.sum(axis=(0, 1)) / space.weights.sum()
    d = np.abs(get_piezo_coefficients(outputs))
    by_parts = CANCELLATION_FRACTION * _combine_stress_integrals(np.abs(integrals), d)
    by_mean_stress = negligible * compute_output_areas(outputs) * (d @ mean_stress)
    charges = np.abs(combine_charges(outputs, integrals))
    scales = np.maximum(charges, np.maximum(by_parts, by_mean_stress))
    return np.where(scales > 0.0, scales, 1.0)


def measure_area_defects(
    outputs: Sequence[Output], space: Space, *, sector: SymmetrySector = WHOLE_FILM
) -> Array:
    """Compute the relative difference between an electrode's area and that of its elements.

    Parameters
    ----------
    outputs : sequence of Output
        Electrodes on the whole film; on a sector the elements of their reflections are counted.
    space : Space
        A space on the mesh, whose quadrature weights give the areas of the elements.
    sector : SymmetrySector, optional
        The sector that is meshed.

    Returns
    -------
    ndarray, shape (outputs,)
        |meshed area / area - 1|; zero for outputs that the mesh does not follow.
    """
    areas = compute_output_areas(outputs)
    meshed = areas.copy()
    for i, output in enumerate(outputs):
        if output.patch is None:
            continue
        meshed[i] = 0.0
        for reflection in output.reflect(sector):
            elements = reflection.find_elements(space.mesh)
            meshed[i] += space.weights[elements].sum()
    return np.abs(meshed / areas - 1.0)


def _combine_stress_integrals(integrals: Array, d: ArrayLike) -> Array:
    """Compute d31 X + d32 Y from stress integrals, shape (outputs, 2), for each output."""
    return np.asarray((integrals * np.asarray(d)).sum(axis=1))


def _select_film_for_samples(
    membrane: Membrane, sampling: Sampling, sector: SymmetrySector
) -> Laminate:
    """Return the film whose law gives the stress at the sampling points.

    A nonlinear law needs the uneven prestrain at these points; the linear elastic stress of this
    prestrain is added by the caller. If the prestrain is uniform or the law is linear, the film is
    the membrane itself.

    Parameters
    ----------
    membrane : Membrane
        The membrane.
    sampling : Sampling
        The sampling points.
    sector : SymmetrySector
        The sector on which they are.
    """
    if membrane.added is None or membrane.law.is_linear:
        return membrane
    return membrane.at_points(sampling.global_points(membrane.space.mesh) @ sector.frame)


def _iterate_samplings(
    outputs: Sequence[Output], space: Space, sector: SymmetrySector
) -> Iterator[tuple[Observable, Sampling, Array]]:
    """Yield the sampling points of all outputs and their reflections, grouped by observable.

    Parameters
    ----------
    outputs : sequence of Output
        The outputs.
    space : Space
        Finite-element space of the sector.
    sector : SymmetrySector
        The sector, for the reflections.

    Yields
    ------
    observable : Observable
        The observable of a group of outputs.
    sampling : Sampling
        Sampling points of the group. A row that belongs to a reflection has the index of the
        original in `outputs`.
    directions : ndarray, shape (n, 2, 3)
        ``Output.directions`` for each row of the sampling.
    """
    reflections, owners = reflect_outputs(outputs, sector)
    for name, observable in OBSERVABLES.items():
        numbers = [i for i, output in enumerate(reflections) if output.observable == name]
        indices = np.array(numbers, dtype=int)
        if not len(indices):
            continue
        chosen = [reflections[i] for i in indices]
        directions = np.stack([reflection.directions for reflection in chosen])
        for sampling in observable.samplings(chosen, space):
            by_output = replace(sampling, outputs=owners[indices[sampling.outputs]])
            yield observable, by_output, directions[sampling.outputs]
