"""The edge of a contact with a rigid tip on a mesh, and where it should be.

Where the film leaves the tip it does so without a kink. A kink e = [grad w . n] tells how far the
edge is from there: the gap beyond an edge moved by s is e s + k s^2/2 with the jump k of the film's
curvature, which the contact pressure over the tension across the edge gives, so that s = -e/k.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.film.membrane import IDENTITY
from pvdf_fem.film.space import Space, shape_values
from pvdf_fem.mesh.points import facet_quadrature
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.outlines.tip import STEEPEST, Height, Tip

#: Largest overlap of film and tip over the tip's depth.
PENETRATION = 1e-6
#: The same from which a contact has no result, as what it changes is no longer small.
LARGEST = 1e-2


@dataclass(frozen=True, eq=False)
class EdgeFacets:
    """Middles of the facets along a patch, counter-clockwise, seen from outside of it."""

    points: Array  #: In m, (n, 2).
    normals: Array  #: Unit normals outwards, (n, 2).
    lengths: Array  #: Of the facets in m, (n,).
    elements: Indices  #: Outside, (n,).
    nodes: Indices  #: Their scalar dofs, (n, functions).
    functions: Array  #: Values of the shape functions, (n, functions).
    slopes: Array  #: Their gradients in 1/m, (n, functions, 2).

    @classmethod
    def of(cls, space: Space, patch: Indices) -> EdgeFacets:
        """Those of a patch of elements."""
        mesh = space.mesh
        facets, count = np.unique(mesh.t2f[:, patch], return_counts=True)
        facets = facets[count == 1]
        first, second = mesh.f2t[:, facets]
        outer = np.where(np.isin(first, patch), second, first)
        along, tangents = facet_quadrature(mesh, facets, outer, 1)
        points = mesh.mapping().F(along.points, outer)[:, :, 0].T
        normals = np.stack([tangents[:, 0, 1], -tangents[:, 0, 0]], axis=-1)
        outwards = mesh.p[:, mesh.t[:, outer]].mean(axis=1).T - points
        normals *= np.sign((outwards * normals).sum(axis=1))[:, None]
        values = shape_values(space.basis.elem, along.points[:, :, 0])
        slopes = space.gradients_at(outer, along.points)[:, 0]
        x, y = (points - points.mean(axis=0)).T
        order = np.argsort(np.arctan2(y, x))
        lengths, outer = along.weights[order, 0], outer[order]
        values, slopes = values[order], slopes[order]
        nodes = space.nodes[outer]
        return cls(points[order], normals[order], lengths, outer, nodes, values, slopes)

    def values(self, rows: Array) -> Array:
        """Of displacements (n, functions, 3): (n, 3)."""
        return np.einsum("nf,nfc->nc", self.functions, rows)

    def gradient(self, rows: Array) -> Array:
        """Of displacements (n, functions, 3): (n, 3, 2)."""
        return np.einsum("nfa,nfc->nca", self.slopes, rows)


@dataclass(frozen=True, eq=False)
class Edge:
    """The edge of the contact on a mesh, and where it should be."""

    tip: Tip
    facets: EdgeFacets
    height: Height  #: The tip's over the points.
    place: Array  #: The displacement in m, (n, 3).
    gradient: Array  #: Its gradient outside, (n, 3, 2).
    kinks: Array  #: The film's, (n,).
    jumps: Array  #: Of the film's curvature in 1/m, (n,).
    widths: Array  #: Distances of the points from the tip's core in m, (n,).
    tension: Array  #: Across the edge in N/m, (n,).

    @property
    def leaving(self) -> Array:
        """Derivative of the place along the normals, outside, (n, 3)."""
        return np.einsum("nca,na->nc", self.gradient + IDENTITY, self.facets.normals)

    @cached_property
    def fitted(self) -> Outline:
        """Where the edge should be; half as far from the core as it is, or farther by the mean
        distance, at most."""
        return self.grown(1.0)

    def grown(self, ratio: float) -> Outline:
        """Where the edge should be, with its distance from the core times a ratio."""
        most = np.maximum(self.widths, self.widths.mean())
        moves = np.clip(-self.kinks / self.jumps, -0.5 * self.widths, most)
        points = self.facets.points + moves[:, None] * self.facets.normals
        away = self.tip.distances(points)
        return self.tip.fitted(points + (ratio - 1.0) * away.value[:, None] * away.normal)

    @property
    def penetration(self) -> float:
        """Largest gap or overlap in m between the edge and where it should be.

        It is infinite where the film would wrap the tip up to its vertical side.
        """
        if self.widths.max() > STEEPEST * self.tip.radius:
            return np.inf
        moves = self.fitted.signed_distance(self.facets.points)
        return float(np.max(0.5 * self.jumps * moves**2))

    def errors(self, duals: Array) -> Array:
        """What the misfit changes of goals, (goals,), of their dual displacements (dofs, goals).

        Moving the edge by s releases N e e* s, with the kink e* of the dual displacement; e itself
        vanishes on the way, which leaves half of that.
        """
        facets, slope = self.facets, self.height.slope
        rows = duals.reshape(-1, 3, duals.shape[1])[facets.nodes]
        gradient = np.einsum("nfa,nfcg,na->ncg", facets.slopes, rows, facets.normals)
        value = np.einsum("nf,nfcg->ncg", facets.functions, rows[:, :, :2])
        kinks = gradient[:, 2] + np.einsum("nc,ncg->ng", slope, gradient[:, :2])
        kinks += np.einsum("nc,ncd,ndg->ng", self.leaving[:, :2], self.height.hessian, value)
        released = 0.5 * self.tension * facets.lengths * self.kinks**2 / self.jumps
        return released @ kinks
