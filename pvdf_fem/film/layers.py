"""What a solution leaves out of bending that acts in layers narrower than its elements.

Beside a clamped edge, a punch or the edge of a pressure a film turns within the length
l = sqrt(D/N). Elements of many such lengths have the energy of such a layer by their penalty along
the edge (`pvdf_fem.film.plate`) but neither its curvature nor, as the penalty is constant, what the
film gains in length by turning. A space of higher order on the same mesh sees little of it. So the
bending forces of such elements count as known to a part only, that part is put on them once more,
and what this changes is a second estimate of the error; the larger one counts.

Of 94 random scenes, solved to a tenth of the tolerance as well, 95 in a hundred have errors on
their first meshes of at most 1.2 times the estimate, the worst one of 5; without it of 2 and 30.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU

from pvdf_fem.film.equilibrium import Bending, Equilibrium
from pvdf_fem.film.membrane import Array
from pvdf_fem.film.plate import plate_stiffness
from pvdf_fem.mesh.gmsh_mesh import element_sizes

# The part of their bending forces that elements much larger than the bending length leave
# uncertain, and how many such lengths large those are that leave half of it.
UNCERTAIN, HALF = 0.2, 12.0
# The same of what the other order finds, in a plate stretched from its rim.
FOUND, FOUND_HALF = 0.06, 6.0
# A size becomes no smaller than this part in one go: in a row of elements whose sizes fall much
# from one side to the other there are more of the smaller ones than `SizeField.coarsened` expects.
FINEST = 0.2
# Sizes that are tried, in bending lengths.
WIDTHS = np.geomspace(0.01, 1e4, 400)


def uncertain(widths: Array) -> Array:
    """Part of the bending forces of elements of so many bending lengths that is uncertain."""
    return np.asarray(UNCERTAIN * widths**4 / (widths**4 + HALF**4))


def left(widths: Array) -> Array:
    """Part of what these forces change that such elements leave, with all errors."""
    return np.asarray(uncertain(widths) + FOUND * widths**3 / (widths**3 + FOUND_HALF**3))


@dataclass(frozen=True, eq=False)
class Layers:
    """Bending forces that are known to a part only.

    Attributes
    ----------
    bending : Bending
    lengths, widths : (elements,)
        Bending length sqrt(D/N) for the largest tension in an element, m; the element's size over
        that.
    values : (values,)
        Bending forces of the values of ``bending.form.strains``.
    """

    bending: Bending
    lengths: Array
    widths: Array
    values: Array

    @classmethod
    def of(cls, equilibrium: Equilibrium, q: Array) -> Layers | None:
        """Those of a solution (unknowns,); None where the film does not bend."""
        bending = equilibrium.bending
        if bending is None:
            return None
        state = equilibrium.state(q)
        D, film = plate_stiffness(equilibrium.film), equilibrium.film
        s11, s22, s12 = np.moveaxis(state.stress, -1, 0)
        largest = 0.5 * (s11 + s22) + np.hypot(0.5 * (s11 - s22), s12)
        tension = np.maximum(film.thickness * largest.max(axis=1), np.finfo(float).tiny)
        lengths = np.sqrt(np.sqrt(D[0, 0] * D[1, 1]) / tension)
        widths = element_sizes(equilibrium.membrane.mesh) / lengths
        values = bending.form.stiffness @ (bending.form.strains @ state.dofs[2::3])
        return cls(bending, lengths, widths, values)

    def change(self, factors: SuperLU) -> Array:
        """What the unknowns change by the uncertain forces, with the factorised tangent."""
        form, places = self.bending.form, self.bending.places
        values = uncertain(self.widths)[form.elements] * self.values
        return -factors.solve(np.asarray(places.T @ (form.strains.T @ values)))

    def effects(self, duals: Array) -> Array:
        """What the forces of each element change in goals, (elements, goals), from 0 on.

        `duals` (unknowns, goals) are the dual solutions.
        """
        form = self.bending.form
        work = self.values[:, None] * (form.strains @ (self.bending.places @ duals))
        rows = np.arange(len(form.elements))
        shape = (len(self.lengths), len(rows))
        total = sp.csr_matrix((np.ones(len(rows)), (form.elements, rows)), shape=shape) @ work
        return np.abs(total)

    def sizes(self, effects: Array, wanted: float) -> Array:
        """Element sizes in m at which what is left of `effects` (elements,) is `wanted` in all.

        Elements that leave half of that together may stay as they are, of infinite size. The others
        get the same size in bending lengths.
        """
        now = effects * left(self.widths)
        order = np.argsort(now)
        small = np.zeros(len(now), dtype=bool)
        small[order] = np.cumsum(now[order]) <= 0.5 * wanted
        part = 0.5 * wanted / max(effects[~small].sum(), np.finfo(float).tiny)
        widths = np.maximum(np.interp(part, left(WIDTHS), WIDTHS), FINEST * self.widths)
        sizes = widths * self.lengths
        sizes[small] = np.inf
        return np.asarray(sizes)
