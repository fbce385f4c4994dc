"""NGSolve on the same scenes: a membrane of order p on curved meshes of Netgen, one thread.

NGSolve and gmsh each bring their own OpenCASCADE, so NGSolve runs in a process of its own, which
answers one scene per line (`Worker`). Run as a script, this file is that process.

The equations are those of `film.membrane`, as one symbolic energy that NGSolve differentiates.
Newton's method starts from order 1 on the same mesh, inner unknowns are condensed, and the tangent
is factorised with NGSolve's sparse Cholesky (UMFPACK where it is not symmetric).
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from typing import Any

from pvdf_fem.scene.outlines.circle import Circle
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import Scene

NAME = "NGSolve"
#: Names of the probe's faces and of the film's rim in NGSolve's mesh.
PROBE = "probe"
RIM = "rim"


class Worker:
    """A process that solves scenes with NGSolve.

    Raises
    ------
    RuntimeError
        When it does not start; the text tells why, for instance that NGSolve is not installed.
    """

    def __init__(self) -> None:
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "NGS_NUM_THREADS": "1"}
        self._process = subprocess.Popen(
            [sys.executable, "-m", "reports.speed.peer_ngsolve"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=environment,
        )
        started = self._read()
        if "version" not in started:
            self.close()
            raise RuntimeError(started.get("reason", "NGSolve did not start"))
        self.version = str(started["version"])

    def solve(
        self, scene: Scene, order: int, patches: dict[str, float], film: float
    ) -> dict[str, Any]:
        """Solve a scene on a mesh of these sizes in m; keys as in `reports.speed.runs.Outcome`."""
        assert self._process.stdin is not None
        job = {"scene": scene.to_toml(), "order": order, "patches": patches, "film": film}
        try:
            self._process.stdin.write(json.dumps(job) + "\n")
            self._process.stdin.flush()
        except OSError:
            return {"status": "crashed", "reason": "the NGSolve process has ended"}
        return self._read()

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.communicate()

    def _read(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        for line in self._process.stdout:  # NGSolve may print other lines before the answer
            if line.startswith("{"):
                return dict(json.loads(line))
        return {"status": "crashed", "reason": "the NGSolve process has ended"}


def main() -> int:
    """Answer scenes from standard input on standard output, until the input ends."""
    try:
        import ngsolve
    except ImportError as error:
        print(json.dumps({"reason": f"NGSolve is not installed ({error})"}), flush=True)
        return 1
    ngsolve.SetNumThreads(1)
    print(json.dumps({"version": ngsolve.__version__}), flush=True)
    for line in sys.stdin:
        try:
            answer = _solve(**json.loads(line))
        except Exception as error:
            answer = {"status": "crashed", "reason": f"{type(error).__name__}: {error}"}
        print(json.dumps(answer), flush=True)
    return 0


def _solve(scene: str, order: int, patches: dict[str, float], film: float) -> dict[str, Any]:
    start = time.perf_counter()
    parsed = Scene.parse(scene)
    mesh = _mesh(parsed, patches, film)
    mesh.Curve(max(order, 2))
    meshed = time.perf_counter()
    lower = Discretisation(parsed, mesh, 1)
    problem = Discretisation(parsed, mesh, order)
    lower.seed()
    status = lower.newton(tolerance=1e-2)
    if status == "converged" and order > 1:
        problem.start_from(lower)
        status = problem.newton(tolerance=1e-6)
    charges = problem.charges_pC()
    end = time.perf_counter()
    seconds = {"mesh": meshed - start, "solve": end - meshed, "total": end - start}
    answer = {"status": status, "unknowns": problem.space.ndof, "seconds": seconds}
    return {**answer, "charges_pC": charges} if status == "converged" else answer


# -------------------------------------------------------------------------------------- mesh


def _face(outline: Outline) -> Any:
    from netgen.occ import Face, Pnt, Segment, Wire, WorkPlane

    if isinstance(outline, Circle):
        x, y = outline.centre
        return WorkPlane().MoveTo(x, y).Circle(outline.radius).Face()
    points = [Pnt(x, y, 0.0) for x, y in outline.corners]
    corners = zip(points, points[1:] + points[:1], strict=True)
    return Face(Wire([Segment(a, b) for a, b in corners]))


def _mesh(scene: Scene, patches: dict[str, float], film: float, grading: float = 0.3) -> Any:
    """The disc cut by electrodes and probe; a face's name tells in which of them it lies.

    `patches` and `film` are edge lengths in m; `grading` is Netgen's, small for slow growth.
    """
    from netgen.occ import Glue, OCCGeometry, WorkPlane
    from ngsolve import Mesh

    disc = WorkPlane().Circle(scene.film.radius).Face()
    disc.edges.name = RIM
    faces: list[tuple[str, Any]] = [("film", disc)]
    outlines = [(f"electrode {e.name}", e.outline) for e in scene.electrode_list]
    if scene.single_probe is not None:
        outlines.append((PROBE, scene.single_probe.outline))
    for name, outline in outlines:
        if outline.reach >= scene.film.radius * (1.0 - 1e-9):  # the outline is the film's own rim
            faces = [(f"{old}|{name}", face) for old, face in faces]
            continue
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
    return Mesh(geometry.GenerateMesh(maxh=film, grading=grading))


# --------------------------------------------------------------------------------- equations


class Discretisation:
    """The membrane of order p on a mesh: energy, Newton's method, charges."""

    def __init__(self, scene: Scene, mesh: Any, order: int) -> None:
        import ngsolve as ng

        if scene.load.kind == "rigid" and scene.load.contact == "stuck":
            raise ValueError("a sticking punch is not among the peers' scenes")
        self.ng, self.scene, self.mesh = ng, scene, mesh
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

    def _stress(self, gradient: Any) -> tuple[Any, Any, list[Any], list[Any]]:
        """F, the 2nd Piola-Kirchhoff stress (2, 2), and stress and elastic strain in Voigt form."""
        ng, film = self.ng, self.scene.film
        F = gradient + ng.CF((1, 0, 0, 1, 0, 0), dims=(3, 2))
        E, rest = 0.5 * (F.trans * F - ng.Id(2)), film.strain_at_rest.tolist()
        strain = [E[0, 0] + rest[0], E[1, 1] + rest[1], 2.0 * E[0, 1] + rest[2]]
        C = film.stiffness.tolist()
        stress = [sum(C[i][j] * strain[j] for j in range(3) if C[i][j]) for i in range(3)]
        return (
            F,
            ng.CF((stress[0], stress[2], stress[2], stress[1]), dims=(2, 2)),
            stress,
            strain,
        )

    def _gradient(self, parts: Sequence[Any]) -> Any:
        return self.ng.CF(tuple(self.ng.Grad(part) for part in parts), dims=(3, 2))

    def _form(self) -> Any:
        ng, thickness = self.ng, self.scene.film.thickness
        trial, test = self.space.TnT()
        F, _, stress, strain = self._stress(self._gradient(trial))
        density = 0.5 * thickness * sum(s * e for s, e in zip(stress, strain, strict=True))
        form = ng.BilinearForm(self.space, symmetric=not self.follower, condense=self.condense)
        form += ng.Variation(density.Compile() * ng.dx)
        if self.follower:
            normal = ng.Cross(F[:, 0], F[:, 1])
            work = -self.pressure * ng.InnerProduct(normal, ng.CF(tuple(test)))
            form += work.Compile() * ng.dx(self.probe)
        else:
            form += ng.Variation(-self.pressure * trial[2] * ng.dx(self.probe))
        return form

    def seed(self) -> None:
        """Start from the linear membrane's deflection under an estimate of the tension."""
        ng, film, force = self.ng, self.scene.film, self.scene.load.force
        stiffness = film.thickness * film.stiffness[:2, :2].mean()
        induced = 0.3 * math.cbrt(stiffness * (force / film.radius) ** 2)
        tension = induced + max(film.thickness * film.stress_at_rest[:2].mean(), 0.0)
        w, v = self.deflections.TnT()
        laplace = ng.BilinearForm(tension * ng.grad(w) * ng.grad(v) * ng.dx).Assemble()
        load = ng.LinearForm(self.pressure * v * ng.dx(self.probe)).Assemble()
        inverse = laplace.mat.Inverse(self.deflections.FreeDofs(), "sparsecholesky")
        self.solution.components[2].vec.data = inverse * load.vec

    def start_from(self, lower: Discretisation) -> None:
        """Take over a solution of order 1: hierarchical bases share their vertex functions."""
        count = self.mesh.nv
        for component, lower_component in zip(
            self.solution.components, lower.solution.components, strict=True
        ):
            component.vec.FV()[0:count] = lower_component.vec.FV()[0:count]

    def newton(self, tolerance: float, max_iterations: int = 40) -> str:
        """Iterate until the energy norm of a step, over the load's work, is below `tolerance`.

        Returns ``converged``, or why the iteration ended without.
        """
        vec = self.solution.vec
        residual, step = vec.CreateVector(), vec.CreateVector()
        for _ in range(max_iterations):
            self.form.AssembleLinearization(vec)
            self.form.Apply(vec, residual)
            self._newton_step(residual, step)
            work = self.pressure * self.ng.Integrate(
                self.solution.components[2] * self.ng.dx(self.probe), self.mesh
            )
            size = math.sqrt(abs(self.ng.InnerProduct(step, residual) / work))
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

    # ------------------------------------------------------------------------------- charges

    def charges_pC(self) -> dict[str, float]:
        """Charges of the scene's observable."""
        observable = self.scene.numerics.observable
        forces = self._edge_forces if observable == "thesis-edge" else self._area_forces
        d31, d32 = self.scene.film.d31_pC_N, self.scene.film.d32_pC_N
        return {name: d31 * x + d32 * y for name, x, y in forces()}

    def _area_forces(self) -> Iterator[tuple[str, float, float]]:
        _, stress, _, _ = self._stress(self._gradient(self.solution.components))
        for electrode in self.scene.electrode_list:
            patch = self.ng.dx(f".*electrode {electrode.name}.*")
            x, y = (self.ng.Integrate(stress[i, i] * patch, self.mesh) for i in (0, 1))
            yield electrode.name, x, y

    def _edge_forces(self) -> Iterator[tuple[str, float, float]]:
        """Forces from means over the electrodes' edges, of the stresses from both sides."""
        ng = self.ng
        F, stress, _, _ = self._stress(self._gradient(self.solution.components))
        normal = ng.Cross(F[:, 0], F[:, 1])
        sigma = F * stress * F.trans / ng.sqrt(ng.InnerProduct(normal, normal))
        for electrode in self.scene.electrode_list:
            shape = electrode.outline.shape
            x0, y0, x1, y1 = shape.bounds
            means = []
            for axis, (low, high) in enumerate(
                (((x0, y0, x0, y1), (x1, y0, x1, y1)), ((x0, y0, x1, y0), (x0, y1, x1, y1)))
            ):
                on = self._near(low) + self._near(high)
                element_edges = ng.dx(element_boundary=True)
                total = ng.Integrate(on * sigma[axis, axis] * element_edges, self.mesh)
                means.append(total / ng.Integrate(on * element_edges, self.mesh))
            yield electrode.name, shape.area * means[0], shape.area * means[1]

    def _near(self, box: tuple[float, float, float, float]) -> Any:
        """1 on an axis-parallel edge, 0 elsewhere."""
        ng, gap = self.ng, 1e-6 * self.scene.film.radius
        inside: Any = ng.CF(1.0)
        for at, low, high in ((ng.x, box[0], box[2]), (ng.y, box[1], box[3])):
            inside = inside * ng.IfPos((at - low + gap) * (high + gap - at), 1.0, 0.0)
        return inside


if __name__ == "__main__":
    sys.exit(main())
