"""Charges of an electrode on lines from its centre, which the thesis maps it with (section 3.1).

`polynomial_contour` draws isocharge contours as the thesis does (section 3.1.1): it fits a
polynomial to the charge over the distance on each line, takes its root at the charge, and draws a
spline through the roots.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.polynomial import Polynomial

from pvdf_fem.arrays import Array
from pvdf_fem.sweeps.lines import MappingScheme, direction
from pvdf_fem.sweeps.store import Record
from reports.maps.isocharge import Contour, ContourCurve


@dataclass(frozen=True, eq=False)
class Line:
    """Charges on one line."""

    #: Direction, counter-clockwise from +x.
    angle_deg: float
    #: Distances of the probe from the electrode's centre, growing, (n,).
    distances_mm: Array
    #: Charges; NaN where the solve failed, (n,).
    charges_pC: Array


@dataclass(frozen=True, eq=False)
class LineMapping:
    """Charges of an electrode on lines from its centre."""

    #: Name.
    electrode: str
    #: Centre of the electrode, (2,).
    centre_mm: Array
    #: In the order in which a contour passes them.
    lines: tuple[Line, ...]

    @classmethod
    def of(
        cls,
        scheme: MappingScheme,
        records: Sequence[Record],
        d31_pC_N: float,
        d32_pC_N: float,
        observable: str = "material",
    ) -> Self:
        """The charges of a scheme's electrode.

        Parameters
        ----------
        scheme : MappingScheme
        records : sequence of Record
            Those of ``scheme.scenes``, in their order. One set of records serves every pair of
            piezoelectric coefficients and every observable.
        d31_pC_N, d32_pC_N : float
        observable : str

        Raises
        ------
        ValueError
            When there are not as many records as scenes.
        """
        charges = [
            record.charges_pC(d31_pC_N, d32_pC_N, observable)[scheme.electrode]
            if record.converged
            else np.nan
            for record in records
        ]
        distances = [scheme.distances_on(angle) for angle in scheme.angles_deg]
        ends = np.cumsum([len(along) for along in distances])
        if len(charges) != ends[-1]:
            raise ValueError(f"records: {len(charges)} for {ends[-1]} scenes; give one for each")
        lines = map(Line, scheme.angles_deg, distances, np.split(charges, ends[:-1]))
        return cls(scheme.electrode, scheme.centre_mm, tuple(lines))

    def mirrored(self, electrode: str) -> LineMapping:
        """The mapping of the mirror image at the y axis, with another electrode's name.

        It holds for a probe and electrodes that are their own mirror images.
        """
        lines = (replace(line, angle_deg=180.0 - line.angle_deg) for line in self.lines)
        return LineMapping(electrode, self.centre_mm * [-1.0, 1.0], tuple(lines))


def polynomial_contour(mapping: LineMapping, charge_pC: float, degree: int = 5) -> Contour:
    """A contour by the thesis's way: a polynomial and its root on each line, a spline.

    Lines whose polynomial does not reach the charge are left out.

    Parameters
    ----------
    mapping : LineMapping
    charge_pC : float
    degree : int
        Degree of the polynomials, which the thesis does not state. They are fitted by least
        squares; a line with too few points gets the polynomial that passes through them.
    """
    roots = ((line, _root(line, charge_pC, degree)) for line in mapping.lines)
    points = [
        mapping.centre_mm + distance * direction(line.angle_deg)
        for line, distance in roots
        if distance is not None
    ]
    curves = (ContourCurve(np.array(points)),) if len(points) > 1 else ()
    return Contour(mapping.electrode, charge_pC, curves)


def _root(line: Line, charge_pC: float, degree: int) -> float | None:
    """Distance at which the polynomial of a line has a charge; of several the likeliest one.

    The likeliest is that nearest to the two neighbouring points, as far out as possible, between
    which the measured charge passes the given one: the charge falls off away from its electrode.
    """
    solved = np.isfinite(line.charges_pC)
    r, q = line.distances_mm[solved], line.charges_pC[solved]
    if len(r) < 2:
        return None
    polynomial = Polynomial.fit(r, q, min(degree, len(r) - 1))
    roots = (polynomial - charge_pC).roots()
    real = roots.real[np.abs(roots.imag) < 1e-9 * max(1.0, r[-1])]
    inside = real[(real >= r[0]) & (real <= r[-1])]
    if not inside.size:
        return None
    passes = np.flatnonzero((q[:-1] >= charge_pC) != (q[1:] >= charge_pC))
    expected = r[passes[-1] : passes[-1] + 2].mean() if passes.size else r[-1]
    return float(inside[np.argmin(np.abs(inside - expected))])
