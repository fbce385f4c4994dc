"""Charges of CalculiX 2.20 from our input decks, and how to compute them again."""

from __future__ import annotations

import csv
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pvdf_fem import Problem, Scene, compare_deck, solve
from pvdf_fem.mesh.gmsh_mesh import mesh_scene
from pvdf_fem.mesh.subdomains import collect_outlines
from pvdf_fem.solver.first_sizes import ORDER, choose_first_sizes
from pvdf_fem.studies.decks.compare_deck import DEFLECTION, DeckComparison
from pvdf_fem.studies.decks.deck_mesh import make_straight_mesh
from pvdf_fem.view.deck.deck_file import InputDeck
from pvdf_fem.view.deck.deck_loads import compute_deck_loads
from pvdf_fem.view.deck.dialect import DIALECTS
from pvdf_fem.view.files.mesh_grid import MeshGrid
from tests.validation.proof import Number, proof

RECORD = Path(__file__).with_name("calculix.csv")
#: Relative differences allowed after extrapolation.
CHARGE_TOLERANCE = 6e-4
DEFLECTION_TOLERANCE = 1.5e-3
#: Element sizes of the recorded coarse meshes, as a fraction of those of third-order elements.
RECORDED_SIZE = 0.3
PATCHES = [
    {"shape": "circle", "x_mm": 5.0, "y_mm": 9.0, "radius_mm": 4.0, "thickness_um": 30.0},
    {
        "shape": "rectangle",
        "x_mm": -9.0,
        "y_mm": 0.0,
        "width_mm": 6.0,
        "height_mm": 5.0,
        "thickness_um": 10.0,
        "youngs_modulus_GPa": 3.5,
        "poisson_ratio": 0.3,
        "bonded": "before stretching",
        "thermal_expansion_per_K": 2e-5,
    },
]
ORTHOTROPIC = {"film.youngs_modulus_GPa": [2.5, 1.8], "film.shear_modulus_GPa": 0.7}
TRIANGLE = Scene.example("triangle")
SCENES = {
    "dead triangle": TRIANGLE,
    "follower disc": Scene.example("disc").with_(
        **{"load.kind": "follower", "probe.radius_mm": 3.0, "probe.x_mm": 4.0}
    ),
    "patches on an orthotropic film": TRIANGLE.with_(**ORTHOTROPIC, **{"film.patches": PATCHES}),
}


class Row(NamedTuple):
    """A value of CalculiX from a mesh, and from the mesh with each triangle divided into four."""

    scene: str
    elements: int  #: Of the coarse mesh.
    quantity: str
    coarse: float
    fine: float

    @property
    def extrapolated(self) -> float:
        """Richardson's extrapolation: half the size gives a quarter of the error."""
        return self.fine + (self.fine - self.coarse) / 3.0


def run_calculix(scene: Scene, grid: MeshGrid, folder: Path) -> DeckComparison:
    """Write the deck of a mesh, run CalculiX, and compare."""
    problem = Problem.from_scene(scene)
    grid = grid.with_patches({name: grid.patches[name] for name in collect_outlines(scene)})
    loads = compute_deck_loads(problem, make_straight_mesh(grid))
    deck = InputDeck(scene, grid, loads, DIALECTS["calculix"])
    (folder / "film.inp").write_text(deck.format(), "ascii")
    run_ccx(folder)
    return compare_deck(scene, folder / "film.dat")


def run_ccx(folder: Path) -> None:
    """Run CalculiX with the deck ``film.inp`` in a folder."""
    program = shutil.which("ccx")
    assert program is not None
    subprocess.run([program, "film"], cwd=folder, check=True, capture_output=True, timeout=1500)


def divide(grid: MeshGrid) -> MeshGrid:
    """Divide each six-node triangle into four of three nodes, which follow curved sides."""
    a, b, c, ab, bc, ca = grid.triangles.T
    children = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    triangles = np.concatenate([np.stack(child, axis=1) for child in children])
    count = len(grid.triangles)
    patches = {}
    for name, elements in grid.patches.items():
        patches[name] = np.concatenate([elements + count * part for part in range(4)])
    first, last, middle = grid.rim_lines.T
    halves = [np.stack([first, middle], axis=1), np.stack([middle, last], axis=1)]
    return MeshGrid(1, grid.points, triangles, np.concatenate(halves), patches)


def make_grids(scene: Scene, size: float) -> tuple[MeshGrid, MeshGrid]:
    """Make a mesh of three-node triangles, and a finer one in which each is divided into four."""
    sizes = choose_first_sizes(Problem.from_scene(scene), ORDER).scale(size)
    mesh = mesh_scene(scene, sizes)
    return MeshGrid.from_mesh(mesh, order=1), divide(MeshGrid.from_mesh(mesh, order=2))


def record(folder: Path) -> None:
    """Run all decks in a folder, and write `RECORD`: ``record(Path("decks"))``."""
    with RECORD.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(Row._fields)
        for name, scene in SCENES.items():
            coarse_grid, fine_grid = make_grids(scene, RECORDED_SIZE)
            coarse = run_calculix(scene, coarse_grid, folder)
            fine = run_calculix(scene, fine_grid, folder)
            for i, quantity in enumerate(coarse.quantities):
                values = [round(float(found.theirs[i]), 6) for found in (coarse, fine)]
                writer.writerow(Row(name, len(coarse_grid.triangles), quantity, *values))
            file.flush()
            print(name, coarse, fine, fine_grid.triangles.shape, sep="\n", flush=True)


def read_record() -> dict[str, dict[str, Row]]:
    """Return the rows by scene and quantity."""
    rows: dict[str, dict[str, Row]] = {}
    with RECORD.open(encoding="utf-8") as file:
        for line in csv.DictReader(file):
            values = (float(line["coarse"]), float(line["fine"]))
            row = Row(line["scene"], int(line["elements"]), line["quantity"], *values)
            rows.setdefault(row.scene, {})[row.quantity] = row
    return rows


@proof(
    "The same sensors in CalculiX",
    source="CalculiX 2.20 with decks like those of `pvdf-fem deck` (M3D3, large deflections) on two"
    " nested meshes; stresses converted to charges; Richardson's extrapolation",
    why="extrapolation leaves a tenth of the mesh's error of up to 4e-3; the deflection is the"
    " largest one of the nodes, which miss its peak; on the same mesh the codes agree to 2e-5",
)
def calculix() -> Iterator[Number]:
    for name, rows in read_record().items():
        ours = solve(SCENES[name].with_(**{"numerics.tolerance": 1e-4}))
        values = {**ours.charges_pC, DEFLECTION: ours.deflection_max_mm}
        for quantity, row in rows.items():
            label = f"{name}, {quantity}"
            allowed = DEFLECTION_TOLERANCE
            if quantity != DEFLECTION:
                label += " (pC)"
                allowed = CHARGE_TOLERANCE
            yield Number(label, values[quantity], row.extrapolated, allowed)
