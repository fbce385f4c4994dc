"""CalculiX on the same scenes: shells and membranes with thermal pretension, NLGEOM, dead forces.

Meshes have the sizes of the thesis (`linear_mesh`) times a factor. The probe's pressure is
a set of nodal forces, which do not turn with the film; a first step cools the film, a second one
presses. Charges are those of the computed displacements: CalculiX's stresses are Cauchy's, averaged
at the nodes, while the charge is an integral of Piola and Kirchhoff's.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from skfem import MeshTri2

from pvdf_fem import Scene
from pvdf_fem.charges.forces import electrode_forces
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.membrane import Array
from pvdf_fem.mesh.gmsh_mesh import Sizes, mesh_scene, outlines
from reports.chapters.linear_mesh import FILM_SIZE, GROWTH, PATCH_SIZE
from reports.speed.runs import CONVERGED, Outcome

NAME = "CalculiX"
PROGRAM = "ccx"
#: Order of the displacement by element type: six-node shell, six- and three-node membrane.
ELEMENTS = {"S6": 2, "M3D6": 2, "M3D3": 1}
SECTIONS = {"S": "SHELL", "M": "MEMBRANE"}
# First part of a step's load; CalculiX chooses the next ones.
FIRST_PART = 0.1


def version() -> str:
    """CalculiX's version; raises `RuntimeError` if it is absent."""
    if shutil.which(PROGRAM) is None:
        raise RuntimeError(f"{PROGRAM} is not on the path (Debian: calculix-ccx)")
    told = subprocess.run([PROGRAM, "-v"], capture_output=True, text=True, check=False).stdout
    found = re.search(r"Version\s+(\S+)", told)
    return found.group(1) if found else "unknown"


def solve_calculix(scene: Scene, element: str, factor: float, limit: float) -> Outcome:
    """Mesh, write the deck, run CalculiX for `limit` seconds at most, and read displacements."""
    if scene.load.kind != "dead":
        return Outcome("not done", f"the deck is for dead loads only, not {scene.load.kind}")
    start = time.perf_counter()
    size = {name: factor * PATCH_SIZE for name in outlines(scene)}
    mesh = mesh_scene(scene, Sizes(size, GROWTH, factor * FILM_SIZE))
    equilibrium = Equilibrium(scene, mesh, ELEMENTS[element])
    meshed = time.perf_counter()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        nodes = _nodes(equilibrium)
        (folder / "film.inp").write_text("\n".join(_deck(equilibrium, element, nodes)) + "\n")
        environment = {
            "OMP_NUM_THREADS": "1",
            "PATH": str(Path(shutil.which(PROGRAM) or "").parent),
        }
        try:
            ended = subprocess.run(
                [PROGRAM, "film"],
                cwd=folder,
                env=environment,
                capture_output=True,
                text=True,
                timeout=limit,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return Outcome("time limit", f"longer than {limit:g} s", unknowns=3 * len(nodes))
        end = time.perf_counter()
        data = folder / "film.dat"
        moved = _last_displacements(data.read_text() if data.exists() else "", len(nodes))
        if moved is None:
            return Outcome("failed", _complaint(ended.stdout), unknowns=3 * len(nodes))
    x = np.zeros((equilibrium.membrane.basis.N, 3))
    x[nodes] = moved / 1e3
    forces = electrode_forces(scene, equilibrium.membrane, x.ravel())
    values = forces @ [scene.film.d31_pC_N, scene.film.d32_pC_N]
    charges = {e.name: float(q) for e, q in zip(scene.electrode_list, values, strict=True)}
    seconds = {"mesh": meshed - start, "solve": end - meshed, "total": end - start}
    return Outcome(CONVERGED, "", charges, {}, 3 * len(nodes), seconds)


def _nodes(equilibrium: Equilibrium) -> NDArray[np.int64]:
    """The scalar dofs, each one a node; CalculiX's number of a node is its place here plus one."""
    return np.arange(equilibrium.membrane.basis.N)


def _deck(equilibrium: Equilibrium, element: str, nodes: NDArray[np.int64]) -> Iterator[str]:
    """The input file in mm, N and MPa."""
    film, basis = equilibrium.film, equilibrium.membrane.basis
    yield "*NODE, NSET=ALL"
    for number, (x, y) in enumerate(1e3 * basis.doflocs[:, nodes].T, start=1):
        yield f"{number}, {x:.12g}, {y:.12g}, 0."
    yield f"*ELEMENT, TYPE={element}, ELSET=FILM"
    for number, dofs in enumerate(_counter_clockwise(equilibrium.membrane.mesh, basis), start=1):
        yield ", ".join(str(n) for n in (number, *(dofs + 1)))
    yield "*MATERIAL, NAME=PVDF"
    modulus = film.stiffness[0, 0] * (1.0 - film.poisson_ratio**2)
    yield f"*ELASTIC\n{1e-6 * modulus:.12g}, {film.poisson_ratio:.12g}"
    yield f"*EXPANSION, ZERO=0.\n{film.thermal_expansion_per_K:.12g}"
    section = SECTIONS[element[0]]
    yield f"*{section} SECTION, ELSET=FILM, MATERIAL=PVDF\n{1e3 * film.thickness:.12g}"
    yield "*INITIAL CONDITIONS, TYPE=TEMPERATURE\nALL, 0."
    yield "*BOUNDARY"
    for node in np.unique(equilibrium.rim_dofs // 3) + 1:
        yield f"{node}, 1, 3"
    yield f"*STEP, NLGEOM, INC=200\n*STATIC\n{FIRST_PART}, 1."
    yield f"*TEMPERATURE\nALL, {film.temperature_change_K:.12g}\n*END STEP"
    yield f"*STEP, NLGEOM, INC=1000\n*STATIC\n{FIRST_PART}, 1.\n*CLOAD"
    state = equilibrium.membrane.state(np.zeros(equilibrium.membrane.dof_count))
    local = equilibrium.load.forces(state.deformation_gradient)[:, 2::3]
    force = np.bincount(basis.element_dofs.T.ravel(), local.ravel(), basis.N)
    for node in np.flatnonzero(force):
        yield f"{node + 1}, 3, {force[node]:.12g}"
    yield "*NODE PRINT, NSET=ALL, FREQUENCY=1000\nU\n*END STEP"


def _counter_clockwise(mesh: MeshTri2, basis: object) -> Array:
    """Nodes of each element: three vertices, then the midsides of 12, 23, 31."""
    dofs = basis.element_dofs.T.copy()  # type: ignore[attr-defined]
    a, b, c = mesh.p[:, mesh.t].transpose(1, 2, 0)
    clockwise = np.cross(b - a, c - a) < 0.0
    # scikit-fem's midsides are those of 12, 23, 13, the same cycle
    turned = [0, 2, 1, 5, 4, 3][: dofs.shape[1]]
    dofs[clockwise] = dofs[clockwise][:, turned]
    return dofs


def _last_displacements(text: str, count: int) -> Array | None:
    """The last table of displacements, (nodes, 3) in mm, of a step that came to its end."""
    blocks = re.split(r" displacements.*time\s+(\S+)\n", text)
    if len(blocks) < 3 or abs(float(blocks[-2]) - 2.0) > 1e-6:
        return None
    rows = np.array([line.split()[:4] for line in blocks[-1].split("\n") if line.strip()], float)
    found = np.zeros((count, 3))
    found[rows[:, 0].astype(int) - 1] = rows[:, 1:]
    return found if len(rows) == count and np.isfinite(found).all() else None


def _complaint(log: str) -> str:
    lines: Sequence[str] = [line.strip() for line in log.splitlines() if "*ERROR" in line]
    return lines[0] if lines else "the second step did not come to its end"
