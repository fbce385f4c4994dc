"""What a solution leaves out of bending that acts in layers narrower than its elements.

Beside a clamped edge, a punch or the edge of a pressure a film turns within the length
l = sqrt(D/N). Elements of many such lengths have the energy of such a layer by their penalty along
the edge (`pvdf_fem.bending`) but neither its curvature nor, as the penalty is constant, what the
film gains in length by turning. A space of higher order on the same mesh sees little of it. So the
bending forces of such elements count as known to a part only, that part is put on them once more,
and what this changes is an estimate of the error, to be added to that of the other order.

Measured in some hundred scenes of all kinds: with the part below, that sum is between a third of
the true error and, where a layer happens to be met better, ten times it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU

from pvdf_fem.bending import plate_stiffness
from pvdf_fem.equilibrium import Bending, Equilibrium
from pvdf_fem.membrane import Array, MembraneState
from pvdf_fem.mesh import element_sizes

# The part of their bending forces that elements much larger than the bending length leave
# uncertain, and how many such lengths large those are that leave half of it. Elements of three
# bending lengths leave a fiftieth, as a plate stretched from its rim shows.
UNCERTAIN, HALF = 0.3, 12.0


@dataclass(frozen=True, eq=False)
class Layers:
    """Bending forces that are known to a part only.

    Attributes
    ----------
    bending : Bending
    lengths : (elements,)
        Bending length sqrt(D/N) for the largest tension in an element, m.
    uncertain : (elements,)
        Part of an element's bending forces that is uncertain.
    values : (values,)
        These forces, as those of the values of ``bending.form.strains``.
    """

    bending: Bending
    lengths: Array
    uncertain: Array
    values: Array

    @classmethod
    def of(cls, equilibrium: Equilibrium, state: MembraneState) -> Layers | None:
        """Those of a solution; None where the film does not bend."""
        bending = equilibrium.bending
        if bending is None:
            return None
        D, film = plate_stiffness(equilibrium.film), equilibrium.film
        s11, s22, s12 = np.moveaxis(state.stress, -1, 0)
        largest = 0.5 * (s11 + s22) + np.hypot(0.5 * (s11 - s22), s12)
        tension = np.maximum(film.thickness * largest.max(axis=1), np.finfo(float).tiny)
        lengths = np.sqrt(np.sqrt(D[0, 0] * D[1, 1]) / tension)
        widths = element_sizes(equilibrium.membrane.mesh) / lengths
        uncertain = UNCERTAIN * widths**4 / (widths**4 + HALF**4)
        form = bending.form
        values = form.stiffness @ (form.strains @ state.dofs[2::3])
        return cls(bending, lengths, uncertain, uncertain[form.elements] * values)

    def change(self, factors: SuperLU) -> Array:
        """What the unknowns change by these forces, with the factorised tangent."""
        forces = self.bending.places.T @ (self.bending.form.strains.T @ self.values)
        return -factors.solve(np.asarray(forces))

    def shares(self, duals: Array) -> Array:
        """Share of each element in what they change in goals, (elements, goals), from 0 on.

        `duals` (unknowns, goals) are the dual solutions.
        """
        form = self.bending.form
        work = self.values[:, None] * (form.strains @ (self.bending.places @ duals))
        rows = np.arange(len(form.elements))
        shape = (len(self.lengths), len(rows))
        total = sp.csr_matrix((np.ones(len(rows)), (form.elements, rows)), shape=shape) @ work
        return np.abs(total)

    def sizes(self, shares: Array, reduction: float) -> Array:
        """Element sizes in m at which the sum of `shares` is `reduction` times what it was.

        Those that make up half of that together may stay as they are, of infinite size. The others
        get the same size in bending lengths.
        """
        wanted = reduction * shares.sum()
        order = np.argsort(shares)
        small = np.zeros(len(shares), dtype=bool)
        small[order] = np.cumsum(shares[order]) <= 0.5 * wanted
        effect = (shares[~small] / self.uncertain[~small]).sum()
        left = min(0.5 * wanted / effect, 0.999 * UNCERTAIN)
        sizes = HALF * (left / (UNCERTAIN - left)) ** 0.25 * self.lengths
        sizes[small] = np.inf
        return sizes
