"""NGSolve on the scenes of a case: a membrane of order p on curved meshes of Netgen, one thread.

The process reads one job from standard input and writes its rows as a line of JSON. The equations
are the package's, as one symbolic energy that NGSolve differentiates. Newton's method starts from
order 1 on the same mesh, inner unknowns are condensed, and the tangent is factorised with NGSolve's
sparse Cholesky (UMFPACK where it is not symmetric).
"""

from __future__ import annotations

import json
import math
import statistics
import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any

import ngsolve as ng
from netgen.occ import Face, Glue, OCCGeometry, Pnt, Segment, Wire, WorkPlane

from pvdf_fem.scene.outlines.circle import Circle
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import Scene

PROBE, RIM = "probe", "rim"  #: Names of the probe's faces and of the rim in a mesh.
#: Steps of Newton's method end where their energy norm over the work of the load is smaller: on
#: order 1, and on the order that is asked for.
STARTED, SOLVED = 1e-2, 1e-6


def main() -> None:
    """Solve the job on standard input."""
    ng.SetNumThreads(1)
    job = json.load(sys.stdin)
    scene = Scene.parse(job["scene"])
    rows: list[dict[str, Any]] = []
    for number, mesh in enumerate(job["meshes"]):
        for order in job["orders"]:
            found = [_solved(scene, order, mesh) for _ in range(job["rounds"])]
            about = {"order": order, "mesh": number, "status": found[-1][0]}
            about |= {"seconds": statistics.median(seconds for *_, seconds in found)}
            about |= {"unknowns": found[-1][1]}
            charges = found[-1][2].items()
            rows += [{**about, "electrode": name, "charge_pC": q} for name, q in charges] or [about]
    print(json.dumps(rows))


def _solved(
    scene: Scene, order: int, sizes: Mapping[str, Any]
) -> tuple[str, int, dict[str, float], float]:
    """Status, unknowns, charges in pC, and processor seconds from the mesh on."""
    start = time.process_time()
    mesh = _mesh(scene, sizes["patches"], sizes["film"])
    mesh.Curve(max(order, 2))
    lower, problem = Discretisation(scene, mesh, 1), Discretisation(scene, mesh, order)
    lower.seed()
    status = lower.newton(STARTED)
    if status == "converged":
        problem.start_from(lower)
        status = problem.newton(SOLVED)
    charges = problem.charges_pC() if status == "converged" else {}
    return status, problem.space.ndof, charges, time.process_time() - start


def _face(outline: Outline) -> Any:
    if isinstance(outline, Circle):
        x, y = outline.centre
        return WorkPlane().MoveTo(x, y).Circle(outline.radius).Face()
    points = [Pnt(x, y, 0.0) for x, y in outline.corners]
    corners = zip(points, points[1:] + points[:1], strict=True)
    return Face(Wire([Segment(a, b) for a, b in corners]))


def _mesh(scene: Scene, patches: Mapping[str, float], film: float, grading: float = 0.3) -> Any:
    """Mesh the disc, cut by electrodes and probe; the name of a face says in which of them it lies.

    `patches` and `film` are edge lengths in m; `grading` is Netgen's, small for slow growth.
    """
    disc = WorkPlane().Circle(scene.film.radius).Face()
    disc.edges.name = RIM
    faces: list[tuple[str, Any]] = [("film", disc)]
    outlines = [(f"electrode {e.name}", e.outline) for e in scene.electrode_list]
    outlines += [(PROBE, touch.outline) for touch in scene.loaded_probes]
    for name, outline in outlines:
        tool = _face(outline)
        tool.edges.maxh = patches[name]
        cut = []
        for old, face in faces:
            cut += [(f"{old}|{name}", face * tool), (old, face - tool)]
        faces = cut
    pieces = []
    for name, shape in faces:
        for face in shape.faces:
            face.name = name
            pieces.append(face)
    geometry = OCCGeometry(Glue(pieces), dim=2)
    return ng.Mesh(geometry.GenerateMesh(maxh=film, grading=grading))


class Discretisation:
    """The membrane of order p on a mesh: energy, Newton's method, charges."""

    def __init__(self, scene: Scene, mesh: Any, order: int) -> None:
        self.scene, self.mesh = scene, mesh
        self.follower = scene.load.kind == "follower"
        self.condense = order > 2
        self.probe = f".*{PROBE}.*"
        scalar = ng.H1(mesh, order=order, dirichlet=RIM)
        self.deflections = scalar
        if scene.load.kind == "rigid":
            self.deflections = ng.comp.PlateauFESpace(scalar, [mesh.Materials(self.probe)])
        self.space = ng.FESpace([scalar, scalar, self.deflections])
        area = ng.Integrate(ng.CF(1.0) * ng.dx(self.probe), mesh)
        self.pressure = scene.load.force / area
        self.form = self._form()
        self.solution = ng.GridFunction(self.space)

    def _stress(self, parts: Sequence[Any]) -> tuple[Any, list[Any], list[Any]]:
        """F (3, 2), and second Piola-Kirchhoff stress and elastic strain in Voigt's order."""
        gradient = ng.CF(tuple(ng.Grad(part) for part in parts), dims=(3, 2))
        F = gradient + ng.CF((1, 0, 0, 1, 0, 0), dims=(3, 2))
        E, rest = 0.5 * (F.trans * F - ng.Id(2)), self.scene.film.prestrain.tolist()
        strain = [E[0, 0] + rest[0], E[1, 1] + rest[1], 2.0 * E[0, 1] + rest[2]]
        C = self.scene.film.stiffness.tolist()
        return F, [sum(C[i][j] * strain[j] for j in range(3) if C[i][j]) for i in range(3)], strain

    def _form(self) -> Any:
        trial, test = self.space.TnT()
        F, stress, strain = self._stress(trial)
        density = sum(s * e for s, e in zip(stress, strain, strict=True))
        form = ng.BilinearForm(self.space, symmetric=not self.follower, condense=self.condense)
        form += ng.Variation((0.5 * self.scene.film.thickness * density).Compile() * ng.dx)
        if self.follower:
            normal = ng.Cross(F[:, 0], F[:, 1])
            work = -self.pressure * ng.InnerProduct(normal, ng.CF(tuple(test)))
            form += work.Compile() * ng.dx(self.probe)
        else:
            form += ng.Variation(-self.pressure * trial[2] * ng.dx(self.probe))
        return form

    def seed(self) -> None:
        """Start from the linear membrane's deflection under an estimate of the tension."""
        film, force = self.scene.film, self.scene.load.force
        stiffness = film.thickness * film.stiffness[:2, :2].mean()
        induced = 0.3 * math.cbrt(stiffness * (force / film.radius) ** 2)
        tension = induced + max(film.thickness * film.prestress[:2].mean(), 0.0)
        w, v = self.deflections.TnT()
        laplace = ng.BilinearForm(tension * ng.grad(w) * ng.grad(v) * ng.dx).Assemble()
        load = ng.LinearForm(self.pressure * v * ng.dx(self.probe)).Assemble()
        inverse = laplace.mat.Inverse(self.deflections.FreeDofs(), "sparsecholesky")
        self.solution.components[2].vec.data = inverse * load.vec

    def start_from(self, lower: Discretisation) -> None:
        """Take over a solution of order 1: hierarchical bases share their vertex functions."""
        count = self.mesh.nv
        components = zip(self.solution.components, lower.solution.components, strict=True)
        for component, lower_component in components:
            component.vec.FV()[0:count] = lower_component.vec.FV()[0:count]

    def newton(self, tolerance: float, max_iterations: int = 40) -> str:
        """Iterate until the energy norm of a step, over the work of the load, is below `tolerance`.

        Returns ``converged``, or why the iteration ended without.
        """
        vec = self.solution.vec
        residual, step = vec.CreateVector(), vec.CreateVector()
        for _ in range(max_iterations):
            self.form.AssembleLinearization(vec)
            self.form.Apply(vec, residual)
            self._newton_step(residual, step)
            deflected = self.solution.components[2] * ng.dx(self.probe)
            work = self.pressure * ng.Integrate(deflected, self.mesh)
            size = math.sqrt(abs(ng.InnerProduct(step, residual) / work))
            if not math.isfinite(size):
                return "diverged"
            vec.data -= self._length(vec, step, size) * step
            if size < tolerance:
                return "converged"
        return "max_iterations"

    def _newton_step(self, residual: Any, step: Any) -> None:
        form, free = self.form, self.space.FreeDofs(self.condense)
        kind = "umfpack" if self.follower else "sparsecholesky"
        if self.condense:
            residual.data += form.harmonic_extension_trans * residual
        step.data = form.mat.Inverse(free, kind) * residual
        if self.condense:
            step.data += form.harmonic_extension * step
            step.data += form.inner_solve * residual

    def _length(
        self, vec: Any, step: Any, size: float, local_size: float = 1e-2, least: float = 1e-3
    ) -> float:
        """Length of a step, halved until the energy falls or the length is below `least`.

        It is 1 for steps below `local_size`, which keeps the quadratic convergence, and under a
        follower load, which has no energy.
        """
        length = 1.0
        if size < local_size or self.follower:
            return length
        energy, moved = self.form.Energy(vec), vec.CreateVector()
        while length > least:
            moved.data = vec - length * step
            if self.form.Energy(moved) < energy:
                break
            length /= 2.0
        return length

    def charges_pC(self) -> dict[str, float]:
        """Charges from the stress over the area of each electrode."""
        _, stress, _ = self._stress(self.solution.components)
        film = self.scene.film
        density = film.d31_pC_N * stress[0] + film.d32_pC_N * stress[1]
        return {
            e.name: ng.Integrate(density * ng.dx(f".*electrode {e.name}.*"), self.mesh)
            for e in self.scene.electrode_list
        }


if __name__ == "__main__":
    main()
