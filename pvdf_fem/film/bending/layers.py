"""An estimate of the error due to bending layers that are narrower than the elements.

Beside a clamped edge, a punch or the edge of a pressure the slope of a film changes within the
bending length l = sqrt(D/N), with the bending stiffness D and the tension N. In much longer
elements the penalty along the edge (`pvdf_fem.film.bending.plate_form`) represents the energy of
this bending layer, but not its curvature. The penalty is constant, and it leaves out that the film
becomes longer by bending. A space of higher order on the same mesh hardly shows this error.
Therefore a fraction of the bending forces in wide elements is regarded as uncertain. The uncertain
forces are applied to the solution once more; their effect is a second estimate of the error, which
is added to the first.

In 94 random scenes, which were also solved to a tenth of the tolerance, the errors on the first
meshes are at most 1.2 times the estimate in 95 % of the scenes, and 5 times in the worst one;
without this second estimate 2 and 30 times.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU

from pvdf_fem.arrays import Array
from pvdf_fem.film.backing import find_largest_stiffness
from pvdf_fem.film.bending.plate import Plate
from pvdf_fem.film.bending.plate_form import compute_plate_stiffness
from pvdf_fem.film.membrane import compute_principal_values
from pvdf_fem.film.term import State
from pvdf_fem.mesh.size_field import compute_element_sizes

#: Element sizes in bending lengths, at which `estimate_missing_fraction` is tabulated to invert it.
WIDTHS = np.geomspace(0.01, 1e4, 400)


def estimate_uncertain_fraction(
    widths: Array, max_fraction: float = 0.2, half_width: float = 12.0
) -> Array:
    """Estimate the fraction of the bending forces that is uncertain in elements of given sizes.

    Parameters
    ----------
    widths : ndarray, shape (...)
        Element sizes in bending lengths.
    max_fraction : float
        Limit of the fraction for very large elements.
    half_width : float
        Size in bending lengths at which the fraction is half of `max_fraction`.

    Returns
    -------
    ndarray, shape (...)
    """
    return np.asarray(max_fraction * widths**4 / (widths**4 + half_width**4))


def estimate_missing_fraction(
    widths: Array, max_fraction: float = 0.06, half_width: float = 6.0
) -> Array:
    """Estimate the fraction of the effect of bending that elements of given sizes miss.

    It is the sum of `estimate_uncertain_fraction` and of the fraction by which a solution of the
    next higher order differs, which was measured in a plate that is stretched from its rim.

    Parameters
    ----------
    widths : ndarray, shape (...)
        Element sizes in bending lengths.
    max_fraction : float
        Limit of the second summand for very large elements.
    half_width : float
        Size in bending lengths at which the second summand is half of `max_fraction`.

    Returns
    -------
    ndarray, shape (...)
    """
    change_by_order = max_fraction * widths**3 / (widths**3 + half_width**3)
    return np.asarray(estimate_uncertain_fraction(widths) + change_by_order)


@dataclass(frozen=True, eq=False)
class BendingLayers:
    """Bending forces in the elements of a solution, to estimate the error due to bending layers.

    A bending layer is the strip beside an edge in which the slope of the film changes.
    """

    plate: Plate  #: Plate term of the equations.
    expansion: sp.csr_matrix  #: Maps unknowns to dofs, shape (dofs, unknowns).
    #: Bending length sqrt(D/N) in m for the largest tension N in each element, but at most
    #: (D/k)^(1/4) on a backing of the stiffness k; shape (elements,).
    lengths: Array
    widths: Array  #: Element sizes in bending lengths, shape (elements,).
    #: Generalized bending forces, such as moments times quadrature weights, that are conjugate to
    #: the rows of ``plate.form.strains``, shape (values,).
    values: Array

    @classmethod
    def from_state(cls, plate: Plate, expansion: sp.csr_matrix, state: State) -> BendingLayers:
        """Compute the bending lengths and the bending forces of a solution.

        Parameters
        ----------
        plate : Plate
            The plate term of the equations.
        expansion : sparse matrix, shape (dofs, unknowns)
            Matrix that maps unknowns to dofs.
        state : State
            The solution. Elements without tension get a very large bending length.
        """
        film = plate.film
        D = compute_plate_stiffness(film)
        _, largest = compute_principal_values(state.stress)
        tension = np.maximum(film.thickness * largest.max(axis=1), np.finfo(float).tiny)
        mean_D = np.sqrt(D[0, 0] * D[1, 1])
        lengths = np.sqrt(mean_D / tension)
        backing = find_largest_stiffness(film)
        if backing:
            lengths = np.minimum(lengths, (mean_D / backing) ** 0.25)
        return cls(
            plate=plate,
            expansion=expansion,
            lengths=lengths,
            widths=compute_element_sizes(plate.space.mesh) / lengths,
            values=plate.form.stiffness @ (plate.form.strains @ state.dofs[2::3]),
        )

    @property
    def _deflection_matrix(self) -> sp.csr_matrix:
        """Matrix that maps unknowns to deflections, shape (scalar dofs, unknowns)."""
        return self.expansion[2::3]

    def compute_change_of_unknowns(self, factors: SuperLU) -> Array:
        """Compute the change of the unknowns if the uncertain bending forces are applied again.

        The uncertain fraction of the bending forces in each element
        (`estimate_uncertain_fraction`) is added to the residual, and the linearised equations are
        solved once.

        Parameters
        ----------
        factors : SuperLU
            Factors of the tangent at the solution.

        Returns
        -------
        ndarray, shape (unknowns,)
            Displacements in m.
        """
        form = self.plate.form
        values = estimate_uncertain_fraction(self.widths)[form.elements] * self.values
        deflection_forces = form.strains.T @ values
        residual = np.asarray(self._deflection_matrix.T @ deflection_forces)
        return -factors.solve(residual)

    def compute_effects(self, duals: Array) -> Array:
        """Compute by how much the bending forces of each element change each output.

        The change is the absolute work of these forces on the deflection of the dual solution.

        Parameters
        ----------
        duals : ndarray, shape (unknowns, outputs)
            Dual (adjoint) solutions of the outputs.

        Returns
        -------
        ndarray, shape (elements, outputs)
        """
        form = self.plate.form
        dual_strains = form.strains @ (self._deflection_matrix @ duals)
        work = self.values[:, None] * dual_strains
        value_count = len(form.elements)
        entries = np.ones(value_count), (form.elements, np.arange(value_count))
        sum_in_elements = sp.csr_matrix(entries, shape=(len(self.lengths), value_count))
        return np.abs(sum_in_elements @ work)

    def choose_sizes(self, effects: Array, remaining: float, min_ratio: float = 0.2) -> Array:
        """Choose maximum element sizes that limit the error due to bending layers on the next mesh.

        The elements with the smallest errors, which add up to at most half of `remaining`, are not
        limited. All others get one common size in bending lengths, with which their errors add up
        to the other half, unless `min_ratio` prevents it.

        Parameters
        ----------
        effects : ndarray, shape (elements,)
            Absolute changes of an output due to the bending forces in each element.
        remaining : float
            Maximum error of the output on the next mesh, in the unit of `effects`.
        min_ratio : float
            Minimum ratio of the new to the present size. With a smaller ratio, sizes would decrease
            so steeply that more elements become small than `SizeField.coarsen` expects.

        Returns
        -------
        ndarray, shape (elements,)
            Maximum sizes in m; infinite for elements that are not limited.
        """
        missing = effects * estimate_missing_fraction(self.widths)
        order = np.argsort(missing)
        may_stay = np.zeros(len(missing), dtype=bool)
        may_stay[order] = np.cumsum(missing[order]) <= 0.5 * remaining
        total = max(effects[~may_stay].sum(), np.finfo(float).tiny)
        width = np.interp(0.5 * remaining / total, estimate_missing_fraction(WIDTHS), WIDTHS)
        sizes = np.maximum(width, min_ratio * self.widths) * self.lengths
        sizes[may_stay] = np.inf
        return np.asarray(sizes)
