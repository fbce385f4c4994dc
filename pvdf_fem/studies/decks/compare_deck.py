"""Comparing the results of an input deck in CalculiX with those of this package."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.arguments import SceneLike, coerce
from pvdf_fem.solver.adaptive import solve_problem
from pvdf_fem.solver.nonlinear.status import NotConvergedError, Status
from pvdf_fem.studies.decks.deck_mesh import make_straight_mesh, solve_on_mesh
from pvdf_fem.summary import Summary, TabularResult, TextTable
from pvdf_fem.view.deck.calculix_results import CalculixResults
from pvdf_fem.view.deck.deck_charges import compute_deck_charges
from pvdf_fem.view.deck.deck_reader import read_deck_grid
from pvdf_fem.view.deck.restrictions import require_deck

#: Name of the row of the deflection; the other rows have the names of electrodes.
DEFLECTION = "deflection (mm)"


@dataclass(frozen=True, eq=False, repr=False)
class DeckComparison(TabularResult):
    """Charges and largest deflection of CalculiX beside those of this package.

    Attributes
    ----------
    quantities : tuple of str
        Names of the rows: electrodes, whose charges are in pC, and the deflection in mm.
    theirs : ndarray
        Values from the results of CalculiX.
    same_mesh : ndarray
        Values of this package with the same elements on the same mesh.
    ours : ndarray
        Values of this package within the tolerance of the scene.
    """

    quantities: tuple[str, ...]
    theirs: np.ndarray
    same_mesh: np.ndarray
    ours: np.ndarray

    @property
    def differences(self) -> np.ndarray:
        """Relative differences of `theirs` from `ours`, which include the error of the mesh."""
        return self.theirs / self.ours - 1.0

    @property
    def code_differences(self) -> np.ndarray:
        """Relative differences of `theirs` from `same_mesh`."""
        return self.theirs / self.same_mesh - 1.0

    @property
    def mesh_errors(self) -> np.ndarray:
        """Relative differences of `same_mesh` from `ours`: the errors of the deck's mesh."""
        return self.same_mesh / self.ours - 1.0

    def columns(self) -> dict[str, Any]:
        """Return the columns by name; charges are in pC and the deflection is in mm."""
        return {
            "quantity": list(self.quantities),
            "calculix": self.theirs,
            "same_mesh": self.same_mesh,
            "ours": self.ours,
            "difference": self.differences,
            "mesh_error": self.mesh_errors,
        }

    def to_json(self) -> dict[str, Any]:
        """Return the columns as lists of plain values by name."""
        return {name: list(map(_to_plain, column)) for name, column in self.columns().items()}

    def summary(self) -> Summary:
        """Show all values, and the largest differences."""
        table = {
            "": [_label(quantity) for quantity in self.quantities],
            "CalculiX": self.theirs,
            "ours, same mesh": self.same_mesh,
            "ours": self.ours,
            "difference": [f"{value:+.2%}" for value in self.differences],
            "mesh error": [f"{value:+.2%}" for value in self.mesh_errors],
        }
        largest = np.abs(self.differences).max()
        on_mesh = np.abs(self.code_differences).max()
        sentences = [
            f"CalculiX differs by at most {largest:.2%}, and by {on_mesh:.1e} on the same mesh"
        ]
        return Summary("compared", sentences, [TextTable.from_columns(table, max_rows=60)])


def _label(quantity: str) -> str:
    """Return the label of a row, with the unit."""
    return quantity if quantity == DEFLECTION else f"{quantity} (pC)"


def _to_plain(value: Any) -> Any:
    """Return a number or text as a plain value for JSON."""
    return value if isinstance(value, str) else float(value)


def compare_deck(
    scene: SceneLike, results: str | Path, *, deck: str | Path | None = None
) -> DeckComparison:
    """Compare the results of a deck in CalculiX with the charges of this package.

    Parameters
    ----------
    scene : Scene, path, dict or result
        The scene of the deck.
    results : path
        The file ``.dat`` that CalculiX wrote.
    deck : path, optional
        The deck; by default the file ``.inp`` beside the results.

    Returns
    -------
    DeckComparison

    Raises
    ------
    FileError
        If a file cannot be read, or if the deck is not one of this scene.
    SceneError
        If no deck can state the scene.
    NotConvergedError
        If the scene has no solution.

    Notes
    -----
    CalculiX prints Cauchy stresses in the axes of space. They are converted to second
    Piola-Kirchhoff stresses by the displacements of the nodes.

    Examples
    --------
    >>> import subprocess
    >>> write_deck(Scene.example("triangle"), "film.inp")
    >>> subprocess.run(["ccx", "film"])
    >>> print(compare_deck(Scene.example("triangle"), "film.dat"))
    """
    problem = Problem.from_scene(scene)
    require_deck(problem)
    results_path = coerce("results", results, Path)
    default = results_path.with_suffix(".inp")
    deck_path = default if deck is None else coerce("deck", deck, Path)
    found = CalculixResults.read(results_path)
    grid = read_deck_grid(deck_path, problem.scene)
    theirs = compute_deck_charges(problem.scene, grid, found)
    coarse = solve_on_mesh(problem, make_straight_mesh(grid))
    ours = solve_problem(problem)
    if ours.status is not Status.CONVERGED:
        raise NotConvergedError(f"{ours.status}: {ours.reason}")
    deflections = [abs(displacement[2]) for displacement in found.displacements.values()]
    return DeckComparison(
        quantities=(*theirs, DEFLECTION),
        theirs=np.array([*theirs.values(), 1e3 * max(deflections)]),
        same_mesh=np.array([*coarse.charges_pC.values(), coarse.deflection_max_mm]),
        ours=np.array([*ours.charges_pC.values(), ours.deflection_max_mm]),
    )
