"""Scaling laws: pairs of scenes whose results must be in a known ratio."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from pvdf_fem import Scene, solve
from pvdf_fem.mesh.gmsh_mesh import mesh_scene
from pvdf_fem.solution.first_sizes import first_sizes
from pvdf_fem.solution.solution import Solution
from reports.common.page import Cell, Column, Section, Table

BASE = Scene.parse('[probe]\nshape = "rectangle"\nx_mm = 3.0\ny_mm = 2.0')


def laws() -> Section:
    """Section with a table of the laws: the computed exponents and ratios beside the exact ones."""
    columns = [
        Column("law", "law"),
        Column("found", "exponent or ratio", None),
        Column("wanted", "wanted", None),
        Column("difference", "relative difference", None),
    ]
    results = [cube_root(), charge_power(), linear(), similarity(), rounding()]
    cells: list[list[Cell]] = [
        [name, value, expected, abs(value / expected - 1)] for name, value, expected in results
    ]
    return Section("laws", "Scaling laws", (), [Table("extremes-laws", "Laws.", columns, cells)])


Law = tuple[str, float, float]


def cube_root() -> Law:
    """Exponent of the deflection by the force, without pretension and at small slopes."""
    return "deflection ∝ F^(1/3) at ΔT = 0", _exponent(0.0, _deflection), 1 / 3


def charge_power() -> Law:
    """Exponent of the charge by the force, without pretension and at small slopes."""
    return "charge ∝ F^(2/3) at ΔT = 0", _exponent(0.0, lambda end: end.charges_pC["A"]), 2 / 3


def linear() -> Law:
    """Exponent of the deflection by the force, at a pretension that the load does not change."""
    return "deflection ∝ F at ΔT = −150 K", _exponent(-150.0, _deflection), 1.0


def similarity() -> Law:
    """Ratio of the deflections of two films of the same F/h."""
    a = _on(**{"film.thickness_um": 0.5, "load.force_N": 1e-3})
    b = _on(**{"film.thickness_um": 1000.0, "load.force_N": 2.0})
    return "deflection at the same F/h", b.deflection_max_mm / a.deflection_max_mm, 1.0


def rounding() -> Law:
    """Ratio of the charges over the forces of two films of the same F/E."""
    a = _on(**{"film.youngs_modulus_GPa": 1e-3, "load.force_N": 1e-4})
    b = _on(**{"film.youngs_modulus_GPa": 400.0, "load.force_N": 40.0})
    return "charge over force at the same F/E", b.charges_pC["A"] / a.charges_pC["A"] / 4e5, 1.0


def _exponent(temperature_change_K: float, quantity: Callable[[Solution], float]) -> float:
    """Exponent of a quantity by the force, from forces of 1 nN and 1 µN."""
    low, high = (
        quantity(_on(**{"film.temperature_change_K": temperature_change_K, "load.force_N": force}))
        for force in (1e-9, 1e-6)
    )
    return float(np.log(high / low) / np.log(1e3))


def _deflection(solution: Solution) -> float:
    return solution.deflection_max_mm


@cache
def _on(**changes: Any) -> Solution:
    """Solve the changed base scene on the mesh of all laws, so that they hold to rounding."""
    mesh = mesh_scene(BASE, first_sizes(BASE, 3))
    return solve(BASE.with_(**changes), mesh=mesh)
