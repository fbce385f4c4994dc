"""Observables: how the charge of an electrode follows from the film's stress.

A charge is d31 X + d32 Y with two stress integrals X and Y, so that a single solution serves every
pair of piezoelectric coefficients. An observable chooses the stress that is integrated, and the
points where an electrode samples it. To add one, write a class and its line in
`pvdf_fem.scene.registry`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from pkgutil import resolve_name
from typing import ClassVar, NamedTuple

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.sampling import Sampling, sample_areas, sample_edges
from pvdf_fem.film.laws.laminate import Laminate
from pvdf_fem.film.membrane import IDENTITY, compute_strain
from pvdf_fem.film.space import Space
from pvdf_fem.problem.outputs import Output
from pvdf_fem.scene.registry import OBSERVABLE_ENTRIES


class RelativeElementSizes(NamedTuple):
    """Element sizes along outlines on the first mesh, in units of area divided by perimeter."""

    electrode: float  #: Along the outlines of electrodes.
    probe: float  #: Along the outlines of probes.


class Observable(ABC):
    """A definition of the stress integrals of an electrode."""

    name: ClassVar[str]  #: Value of the scene's key ``numerics.observable``.
    #: Whether electrodes have to be rectangles along the axes of their scene, at no voltage.
    needs_edges: ClassVar[bool] = False
    #: Element sizes with which charges reach the usual tolerance in most scenes.
    relative_element_sizes: ClassVar[RelativeElementSizes]

    @abstractmethod
    def stress(self, film: Laminate, gradient: Array) -> Array:
        """Compute the stress that the electrode integrates.

        Parameters
        ----------
        film : Laminate
            The film with its material law and its prestrain.
        gradient : ndarray, shape (..., 3, 2)
            Displacement gradient. It may be complex (for complex-step derivatives): the imaginary
            part of the stress is then the derivative times the imaginary step.

        Returns
        -------
        ndarray, shape (..., 3)
            Components 11, 22, 12 in Pa.
        """

    @abstractmethod
    def samplings(self, outputs: Sequence[Output], space: Space) -> Iterator[Sampling]:
        """Yield the points at which electrodes sample the stress, with quadrature weights.

        Parameters
        ----------
        outputs : sequence of Output
            The electrodes.
        space : Space
            The finite-element space in which the displacement is given.

        Raises
        ------
        ValueError
            If the observable is not defined for one of the electrodes.
        """

    def is_defined_for(self, output: Output) -> bool:
        """Return whether the observable is defined for an electrode.

        If it needs edges, it is defined for rectangles along the axes that carry no voltage.
        """
        # the stress due to a voltage jumps at the electrode's edge, where it has no single value
        return not self.needs_edges or (output.is_aligned_rectangle and output.floating is None)

    def require_defined(self, outputs: Sequence[Output]) -> None:
        """Raise ValueError if the observable is not defined for one of the electrodes."""
        if not all(self.is_defined_for(output) for output in outputs):
            reason = (
                "needs electrodes that are rectangles along x and y at no voltage; use material"
            )
            raise ValueError(f"observable {self.name!r}: {reason}")


class Material(Observable):
    """The integrals of S11 and S22 over the electrode's area on the undeformed film."""

    name = "material"
    relative_element_sizes = RelativeElementSizes(electrode=5.0, probe=2.0)

    def stress(self, film: Laminate, gradient: Array) -> Array:
        """Compute the second Piola-Kirchhoff stress in film axes."""
        return film.stress(compute_strain(gradient))

    def samplings(self, outputs: Sequence[Output], space: Space) -> Iterator[Sampling]:
        """Yield quadrature points over the electrodes' areas, which serve both X and Y."""
        return sample_areas(outputs, space)


class ThesisEdge(Observable):
    """The charge that the post-processor of Mirbagheri's thesis computes (section 2.1.6, App. 3).

    X = A times the mean of σxx over the left and the right edge, Y = A times the mean of σyy over
    the upper and the lower edge, with the Cauchy stress σ = F S F^T / J in global axes and the
    electrode's area A. The stress on an edge is the mean of its traces from both sides.
    """

    name = "thesis-edge"
    needs_edges = True
    #: Means along edges need smaller elements than integrals over areas.
    relative_element_sizes = RelativeElementSizes(electrode=1.7, probe=1.4)

    def stress(self, film: Laminate, gradient: Array) -> Array:
        """Compute the Cauchy stress F S F^T / J in global axes.

        J is the ratio of deformed to reference area: J² = det FᵀF = det(1 + 2 E).
        """
        strain = compute_strain(gradient)
        e11, e22, e12 = np.moveaxis(strain, -1, 0)
        s11, s22, s12 = np.moveaxis(film.stress(strain), -1, 0)
        F = gradient + IDENTITY
        (x1, x2), (y1, y2), _ = np.moveaxis(F, (-2, -1), (0, 1))
        xx = s11 * x1 * x1 + s22 * x2 * x2 + 2.0 * s12 * x1 * x2
        yy = s11 * y1 * y1 + s22 * y2 * y2 + 2.0 * s12 * y1 * y2
        xy = s11 * x1 * y1 + s22 * x2 * y2 + s12 * (x1 * y2 + x2 * y1)
        J = np.sqrt((1.0 + 2.0 * e11) * (1.0 + 2.0 * e22) - e12 * e12)
        return np.stack([xx, yy, xy], axis=-1) / J[..., None]

    def samplings(self, outputs: Sequence[Output], space: Space) -> Iterator[Sampling]:
        """Yield quadrature points along the electrodes' edges, for X and then for Y."""
        self.require_defined(outputs)
        return sample_edges(outputs, space)


OBSERVABLES: dict[str, Observable] = {
    name: resolve_name(entry.path)() for name, entry in OBSERVABLE_ENTRIES.items()
}
