"""Writing a scene as an input deck for CalculiX or Abaqus."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pvdf_fem.files import replace_file
from pvdf_fem.mesh.subdomains import collect_outlines
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.arguments import SceneLike, coerce
from pvdf_fem.scene.scene_file import format_error
from pvdf_fem.studies.decks.deck_mesh import DeckMesh, make_deck_mesh
from pvdf_fem.summary import Result, Summary, TextTable
from pvdf_fem.view.deck.deck_file import InputDeck
from pvdf_fem.view.deck.deck_loads import compute_deck_loads
from pvdf_fem.view.deck.dialect import DIALECTS
from pvdf_fem.view.deck.restrictions import require_deck
from pvdf_fem.view.files.export_error import ExportError
from pvdf_fem.view.files.mesh_grid import MeshGrid

#: Default of the maximum relative error of charges due to the mesh of a deck.
DECK_TOLERANCE = 3e-3


@dataclass(frozen=True, eq=False, repr=False)
class Deck(Result):
    """An input deck that was written, with the charges that its results should have.

    Attributes
    ----------
    path : Path
        The file.
    program : str
        ``calculix`` or ``abaqus``.
    elements, nodes : int
        Size of the mesh.
    mesh_charges_pC : dict of str to float
        Charges that this package computes with the elements of the deck.
    charges_pC : dict of str to float
        Charges within the tolerance of the scene.
    mesh_error : float
        Largest relative difference of these two, and of the deflections: the error of the mesh.
    """

    path: Path
    program: str
    elements: int
    nodes: int
    mesh_charges_pC: dict[str, float]
    charges_pC: dict[str, float]
    mesh_error: float

    def summary(self) -> Summary:
        """Summarize the deck with the expected charges, and say how to run it."""
        columns: dict[str, Any] = {
            "electrode": list(self.charges_pC),
            "with these elements (pC)": list(self.mesh_charges_pC.values()),
            "ours (pC)": list(self.charges_pC.values()),
        }
        sentences = [
            f"{self.path} for {self.program}: {self.elements} elements, {self.nodes} nodes",
            f"error of the mesh in charges and deflection: {100 * self.mesh_error:.2g} %",
        ]
        notes = []
        if self.program == "calculix":
            stem = self.path.with_suffix("")
            notes.append(f"run `ccx {stem}`, then `pvdf-fem deck SCENE.toml --read {stem}.dat`")
        return Summary("written", sentences, [TextTable.from_columns(columns)], notes=notes)

    def to_json(self) -> dict[str, Any]:
        """Return the deck's size, expected charges and error as plain values."""
        return {
            "file": str(self.path),
            "program": self.program,
            "elements": self.elements,
            "nodes": self.nodes,
            "mesh_charges_pC": self.mesh_charges_pC,
            "charges_pC": self.charges_pC,
            "mesh_error": self.mesh_error,
        }


def write_deck(
    scene: SceneLike,
    path: str | Path,
    *,
    program: str = "calculix",
    tolerance: float = DECK_TOLERANCE,
) -> Deck:
    """Write a scene as an input deck, with which another program checks this package.

    Parameters
    ----------
    scene : Scene, path, dict or result
        The scene, loaded by dead or following pressures, on a film with tension.
    path : path
        The file to write, with the extension ``.inp``.
    program : {"calculix", "abaqus"}
        The program whose input language is written.
    tolerance : float
        Maximum relative error of every charge and of the deflection due to the mesh of the deck,
        from 1e-4 to 0.1.

    Returns
    -------
    Deck

    Raises
    ------
    SceneError
        If a key of the scene has an effect that a deck cannot state.
    ExportError
        If the path has another extension, or the program is not known.
    NotConvergedError
        If the scene has no solution.
    FileError
        If the file cannot be written.

    Notes
    -----
    The elements are membranes of three nodes (M3D3). The film is cooled in a first step, in which
    it is kept flat, and loaded in a second one with large deflections. Layers on the film become a
    sheet with the same membrane forces. The mesh is refined until charges with such elements,
    computed by this package, are within the tolerance.

    Examples
    --------
    >>> deck = write_deck(Scene.example("triangle"), "film.inp")
    >>> deck.mesh_error
    """
    deck_path = coerce("path", path, Path)
    _require_extension(deck_path)
    program = coerce("program", program, str)
    if program not in DIALECTS:
        reason = f"is not known; choose from {', '.join(DIALECTS)}"
        raise ExportError(format_error("program", program, reason))
    tolerance = coerce("tolerance", tolerance, float, (1e-4, 0.1))
    problem = Problem.from_scene(scene)
    require_deck(problem)
    found = make_deck_mesh(problem, tolerance)
    grid = _make_grid(problem, found)
    loads = compute_deck_loads(problem, found.mesh)
    text = InputDeck(problem.scene, grid, loads, DIALECTS[program]).format()
    with replace_file(deck_path) as temporary:
        temporary.write_text(text, "ascii")
    return Deck(
        deck_path,
        program,
        elements=len(grid.triangles),
        nodes=len(grid.points),
        mesh_charges_pC=found.coarse.charges_pC,
        charges_pC=found.reference.charges_pC,
        mesh_error=found.error,
    )


def _require_extension(path: Path) -> None:
    """Raise `ExportError` unless the path of a deck ends in ``.inp``."""
    if path.suffix.lower() != ".inp":
        raise ExportError(f"{path}: has no extension .inp; give a name that ends in .inp")


def _make_grid(problem: Problem, found: DeckMesh) -> MeshGrid:
    """Make the grid of a deck's mesh, with the patches in the order of the scene."""
    grid = MeshGrid.from_mesh(found.mesh, order=1)
    names = collect_outlines(problem.scene)
    return grid.with_patches({name: grid.patches[name] for name in names})
