"""Scaling laws: one scene after another whose results must be in a known ratio."""

from __future__ import annotations

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
    """A table of the laws, with what was found and what follows from them."""
    columns = [
        Column("law", "law"),
        Column("found", "exponent or ratio", None),
        Column("wanted", "wanted", None),
        Column("difference", "relative difference", None),
    ]
    found = [cube_root(), charge_power(), linear(), similarity(), rounding()]
    cells: list[list[Cell]] = [
        [name, value, wanted, abs(value / wanted - 1)] for name, value, wanted in found
    ]
    return Section("laws", "Scaling laws", (), [Table("extremes-laws", "Laws.", columns, cells)])


Law = tuple[str, float, float]


def cube_root() -> Law:
    """w against F without pretension and at small slopes."""
    a, b = (_on(**{"film.temperature_change_K": 0.0, "load.force_N": f}) for f in (1e-9, 1e-6))
    exponent = np.log(b.deflection_max_mm / a.deflection_max_mm) / np.log(1e3)
    return "deflection ∝ F^(1/3) at ΔT = 0", float(exponent), 1 / 3


def charge_power() -> Law:
    """Q against F without pretension and at small slopes."""
    a, b = (_on(**{"film.temperature_change_K": 0.0, "load.force_N": f}) for f in (1e-9, 1e-6))
    exponent = np.log(b.charges_pC["A"] / a.charges_pC["A"]) / np.log(1e3)
    return "charge ∝ F^(2/3) at ΔT = 0", float(exponent), 2 / 3


def linear() -> Law:
    """w against F at a pretension that the load does not change."""
    a, b = (_on(**{"film.temperature_change_K": -150.0, "load.force_N": f}) for f in (1e-9, 1e-6))
    exponent = np.log(b.deflection_max_mm / a.deflection_max_mm) / np.log(1e3)
    return "deflection ∝ F at ΔT = −150 K", float(exponent), 1.0


def similarity() -> Law:
    """Deflection of films of the same F/h."""
    a = _on(**{"film.thickness_um": 0.5, "load.force_N": 1e-3})
    b = _on(**{"film.thickness_um": 1000.0, "load.force_N": 2.0})
    return "deflection at the same F/h", b.deflection_max_mm / a.deflection_max_mm, 1.0


def rounding() -> Law:
    """The same film in other units: F, E and the pretension strain's size play no part."""
    a = _on(**{"film.youngs_modulus_GPa": 1e-3, "load.force_N": 1e-4})
    b = _on(**{"film.youngs_modulus_GPa": 400.0, "load.force_N": 40.0})
    return "charge over force at the same F/E", b.charges_pC["A"] / a.charges_pC["A"] / 4e5, 1.0


@cache
def _on(**changes: Any) -> Solution:
    """All on one mesh, so that the laws hold to rounding."""
    mesh = mesh_scene(BASE, first_sizes(BASE, 3))
    return solve(BASE.with_(**changes), mesh=mesh)
