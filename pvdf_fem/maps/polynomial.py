"""Fitted polynomials in one variable, such as those that Mirbagheri's thesis prints.

They are evaluated as printed, coefficients highest power first, so that the errors of their
rounded coefficients show.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

# Roots this close to the real axis or beyond an end of the range, in units of the variable, count.
REAL = 1e-7


@dataclass(frozen=True)
class Polynomial:
    """A polynomial, and where it comes from.

    Parameters
    ----------
    name : str
        Number of the equation or another label.
    coefficients : tuple of float
        Highest power first.
    variable_unit : str
        Unit of the variable, ``rad`` or ``N``.
    electrode, output : str
        Whose charge it is, and the unit in which it comes: pC, or a charge it is divided by.
    """

    name: str
    coefficients: tuple[float, ...]
    variable_unit: str
    electrode: str = ""
    output: str = "charge_pC"

    def __call__(self, x: ArrayLike) -> Floats:
        """Values at x (any shape), in `variable_unit`."""
        return np.polyval(self.coefficients, np.asarray(x, dtype=float))

    def solutions(self, value: float, low: float, high: float) -> tuple[float, ...]:
        """Where in [low, high] the polynomial has a value, ascending."""
        shifted = np.array(self.coefficients)
        shifted[-1] -= value
        return _real_in(np.roots(shifted), low, high)

    def turning_points(self, low: float, high: float) -> tuple[float, ...]:
        """Where in ]low, high[ the polynomial stops rising or falling, ascending."""
        slope = np.polyder(self.coefficients)
        found = np.array(_real_in(np.roots(slope), low, high), dtype=float)
        # a double root is no turning point
        found = found[np.diff(found, prepend=-np.inf) > REAL]
        ends = np.concatenate([[low], found, [high]])
        signs = np.sign(np.polyval(slope, (ends[1:] + ends[:-1]) / 2))
        return tuple(found[(signs[1:] != signs[:-1]) & (found > low) & (found < high)].tolist())

    def multiplicity(self, low: float, high: float) -> tuple[tuple[float, float, int], ...]:
        """How many solutions in [low, high] the values have.

        Returns
        -------
        tuple of (lower value, upper value, number of solutions)
            Ascending; between two neighbouring values at turning points or ends the number is
            constant. A value whose number is 1 is reached at one place only.
        """
        ends = np.array([low, *self.turning_points(low, high), high])
        values = self(ends)
        lower, upper = np.minimum(values[1:], values[:-1]), np.maximum(values[1:], values[:-1])
        levels = np.unique(values)
        # turning points and ends of one height differ by rounding
        levels = levels[np.diff(levels, prepend=-np.inf) > REAL * np.ptp(levels)]
        middles = (levels[1:] + levels[:-1]) / 2
        counts = ((lower < middles[:, None]) & (middles[:, None] < upper)).sum(axis=1)
        return tuple(
            (float(a), float(b), int(n))
            for a, b, n in zip(levels[:-1], levels[1:], counts, strict=True)
        )


@dataclass(frozen=True)
class Product:
    """A charge in pC as a polynomial in an angle times a polynomial in a force."""

    name: str
    angle: Polynomial
    force: Polynomial

    def charge_pC(self, angle_deg: ArrayLike, force_N: ArrayLike) -> Floats:
        """Charge in pC; angles in degrees and forces in N broadcast against each other."""
        return self.angle(np.radians(angle_deg)) * self.force(force_N)


def read_polynomials(path: Path) -> tuple[dict[str, Polynomial], dict[str, Product]]:
    """Polynomials and products of a TOML file by their names.

    The file has tables ``[[polynomial]]`` with ``id, electrode, variable_unit, output,
    coefficients`` and ``[[product]]`` with ``id, electrode, angle_coefficients,
    force_coefficients``. An entry with ``derived_refit_coefficients`` gives a second polynomial,
    named "<id> refit".

    Raises
    ------
    KeyError
        When an entry lacks one of these keys.
    """
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    polynomials: dict[str, Polynomial] = {}
    for entry in tables.get("polynomial", []):
        polynomials[entry["id"]] = _polynomial(entry, entry["id"], entry["coefficients"])
        if "derived_refit_coefficients" in entry:
            name = f"{entry['id']} refit"
            polynomials[name] = _polynomial(entry, name, entry["derived_refit_coefficients"])
    products = {
        entry["id"]: Product(entry["id"], _factor(entry, "angle"), _factor(entry, "force"))
        for entry in tables.get("product", [])
    }
    return polynomials, products


def _polynomial(entry: Mapping[str, Any], name: str, coefficients: Sequence[float]) -> Polynomial:
    return Polynomial(
        name, tuple(coefficients), entry["variable_unit"], entry["electrode"], entry["output"]
    )


def _factor(entry: Mapping[str, Any], of: str) -> Polynomial:
    """One factor of a product: the angle's is a ratio, the force's a charge."""
    unit, output = {"angle": ("rad", "ratio"), "force": ("N", "charge_pC")}[of]
    coefficients = tuple(entry[f"{of}_coefficients"])
    return Polynomial(f"{entry['id']}, {of}", coefficients, unit, entry["electrode"], output)


def _real_in(roots: NDArray[np.inexact[Any]], low: float, high: float) -> tuple[float, ...]:
    real = roots.real[np.abs(roots.imag) < REAL]
    inside = real[(real > low - REAL) & (real < high + REAL)]
    return tuple(np.sort(np.clip(inside, low, high)).tolist())
