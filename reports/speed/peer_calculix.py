"""CalculiX on the same scenes: shells and membranes with thermal pretension, NLGEOM, dead forces.

Meshes have the sizes of the thesis times a factor. The probe's pressure is
a set of nodal forces, which do not turn with the film; a first step cools the film, a second one
presses. Charges come from the computed displacements, since CalculiX's stresses are Cauchy's,
averaged at the nodes, while the charge is an integral of the 2nd Piola-Kirchhoff stress.
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
from skfem import MeshTri2

from pvdf_fem import Scene
from pvdf_fem.arrays import Array
from pvdf_fem.charges.forces import goal_forces
from pvdf_fem.charges.goals import goals_of
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.mesh.gmsh_mesh import mesh_scene, outlines
from pvdf_fem.mesh.size_field import Sizes
from reports.speed.runs import CONVERGED, Outcome

NAME = "CalculiX"
#: Sizes of the thesis's elements in m: in the probe and the electrodes, elsewhere, and the growth
#: between them.
PATCH_SIZE, FILM_SIZE, GROWTH = 0.75e-3, 1.0e-3, 0.05
PROGRAM = "ccx"
#: Order of the displacement by element type: six-node shell, six- and three-node membrane.
ELEMENTS = {"S6": 2, "M3D6": 2, "M3D3": 1}
SECTIONS = {"S": "SHELL", "M": "MEMBRANE"}


def version() -> str:
    """CalculiX's version; raises `RuntimeError` if it is absent."""
    if shutil.which(PROGRAM) is None:
        raise RuntimeError(f"{PROGRAM} is not on the path (Debian: calculix-ccx)")
    output = subprocess.run([PROGRAM, "-v"], capture_output=True, text=True, check=False).stdout
    match = re.search(r"Version\s+(\S+)", output)
    return match.group(1) if match else "unknown"


def solve_calculix(scene: Scene, element: str, factor: float, limit: float) -> Outcome:
    """Mesh, write the deck, run CalculiX for `limit` seconds at most, and read displacements."""
    if scene.load.kind != "dead":
        return Outcome("not done", f"the deck is for dead loads only, not {scene.load.kind}")
    start = time.perf_counter()
    size = {name: factor * PATCH_SIZE for name in outlines(scene)}
    mesh = mesh_scene(scene, Sizes(size, GROWTH, factor * FILM_SIZE))
    equilibrium = Equilibrium(scene, mesh, ELEMENTS[element])
    meshed = time.perf_counter()
    nodes = equilibrium.space.basis.N
    try:
        log, data = _run("\n".join(_deck(equilibrium, element)) + "\n", limit)
    except subprocess.TimeoutExpired:
        return Outcome("time limit", f"longer than {limit:g} s", unknowns=3 * nodes)
    end = time.perf_counter()
    displacements = _last_displacements(data, nodes)
    if displacements is None:
        return Outcome("failed", _complaint(log), unknowns=3 * nodes)
    forces = goal_forces(goals_of(scene), equilibrium.membrane, displacements.ravel() / 1e3)
    values = forces @ [scene.film.d31_pC_N, scene.film.d32_pC_N]
    charges = {e.name: float(q) for e, q in zip(scene.electrode_list, values, strict=True)}
    seconds = {"mesh": meshed - start, "solve": end - meshed, "total": end - start}
    return Outcome(CONVERGED, "", charges, {}, 3 * nodes, seconds)


def _run(deck: str, limit: float) -> tuple[str, str]:
    """Run CalculiX on a deck; its log, and the file of results or an empty text."""
    environment = {"OMP_NUM_THREADS": "1", "PATH": str(Path(shutil.which(PROGRAM) or "").parent)}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "film.inp").write_text(deck)
        ended = subprocess.run(
            [PROGRAM, "film"],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=limit,
            check=False,
        )
        results = folder / "film.dat"
        return ended.stdout, results.read_text() if results.exists() else ""


def _deck(equilibrium: Equilibrium, element: str, first_part: float = 0.1) -> Iterator[str]:
    """The input file in mm, N and MPa.

    CalculiX numbers the scalar dofs, each of them a node, from 1 on. It applies `first_part` of a
    step's load at first, and chooses the following parts itself.
    """
    film, basis = equilibrium.film, equilibrium.space.basis
    yield "*NODE, NSET=ALL"
    for number, (x, y) in enumerate(1e3 * basis.doflocs.T, start=1):
        yield f"{number}, {x:.12g}, {y:.12g}, 0."
    yield f"*ELEMENT, TYPE={element}, ELSET=FILM"
    for number, dofs in enumerate(_counter_clockwise(equilibrium.space.mesh, basis), start=1):
        yield ", ".join(str(n) for n in (number, *(dofs + 1)))
    yield "*MATERIAL, NAME=PVDF"
    modulus = film.stiffness[0, 0] * (1.0 - film.poisson_ratio**2)
    yield f"*ELASTIC\n{1e-6 * modulus:.12g}, {film.poisson_ratio:.12g}"
    yield f"*EXPANSION, ZERO=0.\n{film.thermal_expansion_per_K:.12g}"
    section = SECTIONS[element[0]]
    yield f"*{section} SECTION, ELSET=FILM, MATERIAL=PVDF\n{1e3 * film.thickness:.12g}"
    yield "*INITIAL CONDITIONS, TYPE=TEMPERATURE\nALL, 0."
    yield "*BOUNDARY"
    for node in np.unique(equilibrium.clamped // 3) + 1:
        yield f"{node}, 1, 3"
    yield f"*STEP, NLGEOM, INC=200\n*STATIC\n{first_part}, 1."
    yield f"*TEMPERATURE\nALL, {film.temperature_change_K:.12g}\n*END STEP"
    yield f"*STEP, NLGEOM, INC=1000\n*STATIC\n{first_part}, 1.\n*CLOAD"
    state = equilibrium.membrane.state(np.zeros(equilibrium.space.dof_count))
    force = equilibrium.load_forces(state)[2::3]
    for node in np.flatnonzero(force):
        yield f"{node + 1}, 3, {force[node]:.12g}"
    yield "*NODE PRINT, NSET=ALL, FREQUENCY=1000\nU\n*END STEP"


def _counter_clockwise(mesh: MeshTri2, basis: object) -> Array:
    """Nodes of each element: three vertices, then the midsides of 12, 23, 31."""
    dofs = basis.element_dofs.T.copy()  # type: ignore[attr-defined]
    a, b, c = mesh.p[:, mesh.t].transpose(1, 2, 0)
    clockwise = np.cross(b - a, c - a) < 0.0
    # The midsides of scikit-fem are those of 12, 23, 13, which is the same cycle.
    turned = [0, 2, 1, 5, 4, 3][: dofs.shape[1]]
    dofs[clockwise] = dofs[clockwise][:, turned]
    return dofs


def _last_displacements(text: str, count: int) -> Array | None:
    """The last table of displacements, (nodes, 3) in mm, of a step that came to its end."""
    blocks = re.split(r" displacements.*time\s+(\S+)\n", text)
    if len(blocks) < 3 or abs(float(blocks[-2]) - 2.0) > 1e-6:
        return None
    rows = np.array([line.split()[:4] for line in blocks[-1].split("\n") if line.strip()], float)
    displacements = np.zeros((count, 3))
    displacements[rows[:, 0].astype(int) - 1] = rows[:, 1:]
    return displacements if len(rows) == count and np.isfinite(displacements).all() else None


def _complaint(log: str) -> str:
    lines: Sequence[str] = [line.strip() for line in log.splitlines() if "*ERROR" in line]
    return lines[0] if lines else "the second step did not come to its end"
