"""Polynomials that the thesis prints: a charge against an angle or a force.

They keep the printed digits of their coefficients, so that the errors of rounding show.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike

from pvdf_fem.arrays import Array

#: Rounding errors of roots, in units of the variable, and of values, relative to their range.
ROUNDING = 1e-7


@dataclass(frozen=True)
class PrintedPolynomial:
    """A polynomial, and where it comes from.

    Parameters
    ----------
    name : str
        Number of the equation or another label.
    series : numpy.polynomial.Polynomial
    variable_unit : str
        Unit of the variable, ``rad`` or ``N``.
    electrode : str
        Name of the electrode whose charge the polynomial gives.
    output : str
        ``charge_pC``, or ``ratio`` for a charge that is divided by another.
    """

    name: str
    series: Polynomial
    variable_unit: str
    electrode: str = ""
    output: str = "charge_pC"

    def __call__(self, x: ArrayLike) -> Array:
        """Values at x (any shape), in `variable_unit`."""
        return np.asarray(self.series(np.asarray(x, dtype=float)))

    def solutions(self, value: float, low: float, high: float) -> tuple[float, ...]:
        """Places in [low, high] at which the polynomial has a value, ascending."""
        return tuple(_real_roots(self.series - value, low, high).tolist())

    def angles_deg(
        self, value: float, low_deg: float = 0.0, high_deg: float = 90.0
    ) -> tuple[float, ...]:
        """Angles in degrees at which a polynomial in radians has a value, ascending.

        This is how the thesis finds an angle (Tables 4.2, 4.3); `multiplicity` tells where there is
        only one.

        Raises
        ------
        ValueError
            For a polynomial in another variable.
        """
        if self.variable_unit != "rad":
            reason = f"is a polynomial in {self.variable_unit}; give one in rad"
            raise ValueError(f"{self.name} {reason}")
        low, high = math.radians(low_deg), math.radians(high_deg)
        return tuple(math.degrees(angle) for angle in self.solutions(value, low, high))

    def turning_points(self, low: float, high: float) -> tuple[float, ...]:
        """Places in ]low, high[ at which the polynomial stops rising or falling, ascending."""
        slope = self.series.deriv()
        flat = _real_roots(slope, low, high)
        # a double root is no turning point
        flat = flat[np.diff(flat, prepend=-np.inf) > ROUNDING]
        ends = np.concatenate([[low], flat, [high]])
        signs = np.sign(slope((ends[1:] + ends[:-1]) / 2))
        return tuple(flat[(signs[1:] != signs[:-1]) & (flat > low) & (flat < high)].tolist())

    def multiplicity(self, low: float, high: float) -> tuple[tuple[float, float, int], ...]:
        """How often the polynomial takes its values in [low, high].

        Returns
        -------
        tuple of (lower value, upper value, number of solutions)
            Ascending; the number is constant between two neighbouring values at turning points or
            ends. A value whose number is 1 is reached at one place only.
        """
        values = self(np.array([low, *self.turning_points(low, high), high]))
        lower, upper = np.minimum(values[1:], values[:-1]), np.maximum(values[1:], values[:-1])
        levels = np.unique(values)
        # turning points and ends of one height differ by rounding
        levels = levels[np.diff(levels, prepend=-np.inf) > ROUNDING * np.ptp(levels)]
        middles = (levels[1:] + levels[:-1]) / 2
        counts = ((lower < middles[:, None]) & (middles[:, None] < upper)).sum(axis=1)
        rows = zip(levels[:-1].tolist(), levels[1:].tolist(), counts.tolist(), strict=True)
        return tuple(rows)


@dataclass(frozen=True)
class PrintedProduct:
    """A charge in pC as a polynomial in an angle times a polynomial in a force."""

    name: str
    angle: PrintedPolynomial
    force: PrintedPolynomial

    def charge_pC(self, angle_deg: ArrayLike, force_N: ArrayLike) -> Array:
        """Charge in pC; angles in degrees and forces in N broadcast against each other."""
        return self.angle(np.radians(angle_deg)) * self.force(force_N)


def read_polynomials(
    path: Path,
) -> tuple[dict[str, PrintedPolynomial], dict[str, PrintedProduct]]:
    """Polynomials and products of a TOML file by their names.

    The file has tables ``[[polynomial]]`` with ``id, electrode, variable_unit, output,
    coefficients`` and ``[[product]]`` with ``id, electrode, angle_coefficients,
    force_coefficients``; coefficients begin with the highest power. An entry with
    ``derived_refit_coefficients`` gives a second polynomial, named "<id> refit".

    Raises
    ------
    KeyError
        When an entry lacks one of these keys.
    """
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    polynomials: dict[str, PrintedPolynomial] = {}
    for entry in tables.get("polynomial", []):
        polynomials[entry["id"]] = _polynomial(entry, entry["id"], entry["coefficients"])
        if "derived_refit_coefficients" in entry:
            name = f"{entry['id']} refit"
            polynomials[name] = _polynomial(entry, name, entry["derived_refit_coefficients"])
    products = {entry["id"]: _product(entry) for entry in tables.get("product", [])}
    return polynomials, products


def _polynomial(
    entry: Mapping[str, Any], name: str, coefficients: Sequence[float]
) -> PrintedPolynomial:
    series = Polynomial(coefficients[::-1])
    unit, electrode, output = (entry[key] for key in ("variable_unit", "electrode", "output"))
    return PrintedPolynomial(name, series, unit, electrode, output)


def _product(entry: Mapping[str, Any]) -> PrintedProduct:
    """A product: the angle's factor is a ratio, the force's a charge."""
    units = {
        "angle": {"variable_unit": "rad", "output": "ratio"},
        "force": {"variable_unit": "N", "output": "charge_pC"},
    }
    factors = (
        _polynomial(
            {**entry, **unit}, f"{entry['id']}, {variable}", entry[f"{variable}_coefficients"]
        )
        for variable, unit in units.items()
    )
    return PrintedProduct(entry["id"], *factors)


def _real_roots(series: Polynomial, low: float, high: float) -> Array:
    """Real roots in [low, high] up to rounding, ascending, (n,)."""
    roots = np.asarray(series.roots(), dtype=complex)
    real = roots.real[np.abs(roots.imag) < ROUNDING]
    inside = real[(real > low - ROUNDING) & (real < high + ROUNDING)]
    return np.sort(np.clip(inside, low, high))
