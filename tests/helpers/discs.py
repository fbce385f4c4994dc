"""Scenes and meshes that several tests of the solver share."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
from skfem import MeshTri2

from pvdf_fem import Scene, Solution, solve
from pvdf_fem.arrays import Array
from pvdf_fem.mesh.gmsh_mesh import mesh_scene
from pvdf_fem.mesh.size_field import GradedSizes
from pvdf_fem.mesh.subdomains import collect_outlines
from pvdf_fem.problem.problem import Problem

LOADS = {
    "dead": {"load.kind": "dead"},
    "follower": {"load.kind": "follower"},
    "sliding": {"load.kind": "rigid"},
    "stuck": {"load.kind": "rigid", "load.contact": "stuck"},
}
RECTANGLE = Scene.parse('[probe]\nshape = "rectangle"')
TRIANGLE = Scene.parse('[probe]\nshape = "triangle"\nx_mm = 5.0714\ny_mm = 0.8757')


def uniform_mesh(scene: Scene, size_mm: float) -> MeshTri2:
    """A mesh of one element size."""
    size = size_mm / 1e3
    return model_mesh(scene, GradedSizes(dict.fromkeys(collect_outlines(scene), size), 1.0, size))


def graded_mesh(scene: Scene, patch_mm: float, film_mm: float, growth: float = 0.4) -> MeshTri2:
    """A mesh that is fine along the outlines of all patches."""
    patches = dict.fromkeys(collect_outlines(scene), patch_mm / 1e3)
    return model_mesh(scene, GradedSizes(patches, growth, film_mm / 1e3))


def model_mesh(scene: Scene, sizes: GradedSizes) -> MeshTri2:
    """A mesh whose elements are as regular as the scene's film model needs them."""
    return mesh_scene(
        scene,
        sizes,
        min_jacobian_ratio=Problem.from_scene(scene).film.mesh_policy.min_jacobian_ratio,
    )


def values(by_name: Mapping[str, float]) -> Array:
    """Numbers of electrodes, (electrodes,)."""
    return np.array([*by_name.values()])


def charges(scene: Scene, **how: object) -> Array:
    """Charges in pC of a solve, (electrodes,)."""
    return values(solve(scene, **how).charges_pC)


@cache
def on_mesh(scene: Scene) -> Solution:
    """The solution of second order on a coarse mesh, once per run."""
    return solve(scene, mesh=graded_mesh(scene, 3.5, 14.0, 0.8), order=2)


def free_disc(
    force: float,
    *,
    poisson_ratio: float,
    patch_radius: float = 1.0,
    pretension: float = 0.0,
    centre: tuple[float, float] = (0.0, 0.0),
    **changes: object,
) -> Scene:
    """A film under a round probe, in the scale-free terms of `reports.reference.axisymmetric`.

    `force` is F/(E h a), `pretension` N0/(E h), lengths are in a. One square electrode, with a
    corner on the film's centre, so that every mesh has a node there.
    """
    radius_mm, thickness_um, modulus_GPa = 50.0, 20.0, 2.0
    stiffness = modulus_GPa * 1e9 * thickness_um * 1e-6
    side_mm = radius_mm / 5
    return Scene().with_(
        **{
            "film.radius_mm": radius_mm,
            "film.thickness_um": thickness_um,
            "film.youngs_modulus_GPa": modulus_GPa,
            "film.poisson_ratio": poisson_ratio,
            "film.thermal_expansion_per_K": 1e-3,
            "film.temperature_change_K": -pretension * (1 - poisson_ratio) / 1e-3,
            "electrodes": [
                {"name": "A", "x_mm": side_mm / 2, "y_mm": side_mm / 2, "side_mm": side_mm}
            ],
            "probe.shape": "circle",
            "probe.radius_mm": patch_radius * radius_mm,
            "probe.x_mm": centre[0] * radius_mm,
            "probe.y_mm": centre[1] * radius_mm,
            "load.force_N": force * stiffness * radius_mm / 1e3,
            **changes,
        }
    )
