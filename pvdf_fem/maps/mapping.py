"""Charges of an electrode on lines from its centre, which the thesis maps it with (section 3.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.sweeps.lines import MappingScheme
from pvdf_fem.sweeps.store import Record


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
