"""A solved round film, scale-free as the closed forms: lengths in a, tensions in E h."""

from __future__ import annotations

import math
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
from skfem import MeshTri2

from pvdf_fem import Scene, Solution, solve
from pvdf_fem.mesh.gmsh_mesh import mesh_scene
from pvdf_fem.mesh.size_field import GradedSizes
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.problem.problem import Problem
from pvdf_fem.solver.nonlinear.status import Status
from tests.helpers.discs import free_disc, uniform_mesh
from tests.helpers.solvers import solve_by_newton
from tests.validation.proof import Number

#: F/(E h a) and p a/(E h) at which slopes vanish, and the scales of deflection and tension there.
SMALL = 1e-10
SLOPE = SMALL ** (1 / 3)
TENSION = SMALL ** (2 / 3)


def solved(scene: Scene, mesh: MeshTri2) -> SimpleNamespace:
    """A film on one mesh to the last digits: places `nodes` (2, nodes) and `deflection` (nodes,) of
    all nodes over a, `centre_deflection`, and `edge_tension` over E h.

    The tension at the rim is the mean of the clamp's reaction in the plane, by the first
    Piola-Kirchhoff stress, which is the radial tension for small slopes.
    """
    equilibrium = Equilibrium(Problem.from_scene(scene), mesh)
    result = solve_by_newton(equilibrium)
    assert result.status is Status.CONVERGED
    dofs, film, membrane = equilibrium.dofs(result.q), scene.film, equilibrium.membrane
    nodes = membrane.space.basis.doflocs / film.radius
    deflection = dofs.reshape(-1, 3)[:, 2] / film.radius
    distance = np.hypot(*nodes)
    assert distance.min() < 1e-12
    forces = membrane.internal_forces(membrane.state(dofs)).reshape(-1, 3)
    rim = membrane.space.basis.get_dofs("rim").all()
    pull = (forces[rim, :2] * nodes[:, rim].T).sum()
    stiffness = film.youngs_modulus_GPa * 1e9 * film.thickness
    return SimpleNamespace(
        nodes=nodes,
        deflection=deflection,
        centre_deflection=deflection[distance.argmin()],
        edge_tension=pull / (2 * math.pi * film.radius * stiffness),
    )


def disc(force: float, size: float = 4.0, **shape: Any) -> SimpleNamespace:
    """The film of `free_disc`, solved on elements of a size in mm, or, under a patch, on a mesh
    graded to the outlines whose sizes are in proportion to the patch times `size`."""
    scene = free_disc(force, **shape)
    if "patch_radius" not in shape:
        return solved(scene, uniform_mesh(scene, size))
    outline, a = scene.probe.outline, scene.film.radius
    sizes = GradedSizes({"probe": 0.4 * outline.radius, "electrode A": 0.08 * a}, 0.3, 0.16 * a)
    return solved(scene, mesh_scene(scene, sizes.scale(size)))


def compared(
    case: str, film: Any, exact: Any, known: dict[str, float], slope: float = 1.0
) -> Iterator[Number]:
    """Numbers of a film beside a solution that is scaled by its `slope` w/a: deflection at the
    centre, tension at the rim, deflection at the worst node, each to the tolerance in `known`."""
    if "centre" in known:
        ours = film.centre_deflection / slope
        quantity = f"deflection at the centre, {case}"
        yield Number(quantity, ours, exact.centre_deflection, known["centre"])
    if "rim" in known:
        ours = film.edge_tension / slope**2
        yield Number(f"tension at the rim, {case}", ours, exact.edge_tension, known["rim"])
    if "worst" in known:
        theirs = slope * exact.deflection(np.minimum(np.hypot(*film.nodes), 1.0))
        worst, size = np.abs(film.deflection - theirs).argmax(), slope * exact.centre_deflection
        pair = float(film.deflection[worst]), float(theirs[worst])
        yield Number(f"deflection where it differs most, {case}", *pair, known["worst"], size)


def solved_to(scene: Scene, tolerance: float) -> Solution:
    """The solution that users get at a tolerance."""
    return solve(scene.with_(**{"numerics.tolerance": tolerance}))
