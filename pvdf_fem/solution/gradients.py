"""Derivatives of every charge with respect to the probe's place, the force and the film.

A charge Q(x, θ) of the displacement x that solves R(x, θ) = 0 has the derivative::

    dQ/dθ = ∂Q/∂θ - λ · ∂R/∂θ,    K^T λ = ∂Q/∂x

with the tangent K, so that one adjoint solve λ per electrode serves all parameters.

R depends on the probe's place through the load's patch. The pressure F/A stays, since translations
and rotations keep the area, and the work of the load on λ changes by what the outline sweeps
(Reynolds' transport theorem)::

    -λ · ∂R/∂θ = p ∮ (λ · t) (V · n) ds

with the outline's velocity V, its outward normal n, and the direction t of the pressure per
reference area: e_z for a dead load, F1 x F2 for a follower load.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from pvdf_fem.arrays import COMPLEX_STEP, Array, Indices
from pvdf_fem.charges.forces import charge_gradients, electrode_forces
from pvdf_fem.charges.quadrature import PlacedQuadrature, facet_quadrature
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.laws import StVenantKirchhoff
from pvdf_fem.film.loads import LOADS
from pvdf_fem.film.membrane import IDENTITY, Membrane
from pvdf_fem.film.models import film_model
from pvdf_fem.film.space import Space, shape_values
from pvdf_fem.scene.film import Film, plane_stress
from pvdf_fem.scene.scene import Probe, Scene
from pvdf_fem.solution.solution import Solution
from pvdf_fem.solvers.newton import factorise

PLACE = ("probe.x_mm", "probe.y_mm", "probe.rotation_deg")
#: Gauss points on an edge, exact for the product of two functions of order 4 on a straight one.
EDGE_POINTS = 5


def gradients(
    solution: Solution, parameters: Sequence[str] | None = None
) -> dict[str, dict[str, float]]:
    """Derivative of each charge with respect to parameters of the scene.

    Parameters
    ----------
    solution : Solution
        A converged one.
    parameters : sequence of str, optional
        Keys of the scene file as in `Scene.with_`, by default all of `parameters_of` the scene.

    Returns
    -------
    dict
        For each key the derivatives by electrode, in pC per unit of the key: in pC/mm for
        ``probe.x_mm``.

    Raises
    ------
    NotConvergedError
        When the solution is not converged.
    ValueError
        For a key that is not among `parameters_of` the scene.
    """
    scene = solution.scene
    known = parameters_of(scene)
    wanted = known if parameters is None else tuple(parameters)
    for key in wanted:
        if key not in known:
            raise ValueError(f"parameters: {key!r} {_refusal(scene, key)}; take some of {known}")
    rates = _rates(_Adjoint.of(solution))
    names = [electrode.name for electrode in scene.electrode_list]
    return {key: dict(zip(names, (1e12 * rates[key]()).tolist(), strict=True)) for key in wanted}


def parameters_of(scene: Scene) -> tuple[str, ...]:
    """Keys of the parameters by which `gradients` differentiates.

    A film with two moduli has ``film.youngs_modulus_GPa.0`` and ``.1``. A rigid probe has no
    derivative by its place, as the tractions along its edge are singular. Of a film that bends or
    wrinkles there is none by what its stiffness depends on.
    """
    probe: tuple[str, ...] = ()
    if scene.probe is not None:
        place = () if LOADS[scene.load.kind].rigid else PLACE
        probe = (*place, "load.force_N")
    film: tuple[str, ...] = ()
    if film_model(scene).film_is_differentiable:
        film = ("film.thickness_um", "film.temperature_change_K", *_moduli(scene.film))
    return (*probe, *film, "film.d31_pC_N", "film.d32_pC_N")


def _moduli(film: Film) -> tuple[str, ...]:
    key = "film.youngs_modulus_GPa"
    pair = isinstance(film.youngs_modulus_GPa, tuple)
    return (*((f"{key}.0", f"{key}.1") if pair else (key,)), "film.poisson_ratio")


def _refusal(scene: Scene, key: str) -> str:
    if scene.probe is not None and key in PLACE:
        return "of a rigid probe has no derivative here: the tractions at its edge are singular"
    if key in ("film.thickness_um", "film.temperature_change_K", *_moduli(scene.film)):
        return "of a film that bends or wrinkles has no derivative here"
    return "is not a parameter of this scene that charges are differentiated by"


@dataclass(frozen=True, eq=False)
class _Adjoint:
    """A solution with the adjoint solutions of its charges."""

    scene: Scene
    equilibrium: Equilibrium
    x: Array  # the displacement, (dofs,)
    forces: Array  # X and Y, (electrodes, 2)
    unknowns: Array  # λ for the charges in C, (unknowns, electrodes)
    dofs: Array  # λ at all dofs, (dofs, electrodes)

    @classmethod
    def of(cls, solution: Solution) -> _Adjoint:
        """One solve per electrode with a new tangent; Newton's last may be an earlier one."""
        scene, fields = solution.scene, solution.fields
        equilibrium, x = fields.equilibrium, fields.displacement
        goals = charge_gradients(scene, equilibrium.membrane, x)
        spread = equilibrium.unknowns.expansion
        unknowns = factorise(equilibrium.tangent(fields.state)).solve(spread.T @ goals, "T")
        return cls(scene, equilibrium, x, fields.forces.values, unknowns, spread @ unknowns)

    def work(self, forces: Array) -> Array:
        """λ · f of forces f on the dofs, (electrodes,)."""
        return forces @ self.dofs

    def of_stress(self, membrane: Membrane) -> Array:
        """∂Q/∂θ - λ · ∂R/∂θ of a stress that `membrane` has where the strain stays, (electrodes,).

        Charges and residual are linear in the stress.
        """
        d = [self.scene.film.d31, self.scene.film.d32]
        explicit = electrode_forces(self.scene, membrane, self.x) @ d
        return explicit - self.work(membrane.internal_forces(membrane.state(self.x)))


def _rates(adjoint: _Adjoint) -> dict[str, Callable[[], Array]]:
    """Functions that give dQ/dθ in C per unit of the key, (electrodes,)."""
    film, membrane = adjoint.scene.film, adjoint.equilibrium.membrane
    state = membrane.state(adjoint.x)

    def by_force() -> Array:
        return adjoint.work(adjoint.equilibrium.load.with_force(1.0).forces(state))

    def by_thickness() -> Array:
        return -adjoint.work(membrane.internal_forces(state)) / film.thickness_um

    def by_temperature() -> Array:
        # the stress is linear in the temperature: the difference over 1 K is the derivative
        degree = {"temperature_change_K": film.temperature_change_K + 1.0}
        warmer = Membrane(membrane.space, film.model_copy(update=degree))
        return adjoint.of_stress(warmer) - adjoint.of_stress(membrane)

    def by_modulus(key: str) -> Array:
        # the stress is linear in the stiffness, whose rate takes its place
        law = StVenantKirchhoff(_stiffness_rate(film, key))
        return adjoint.of_stress(Membrane(membrane.space, film, law))

    return {
        **{key: partial(_swept, adjoint, key) for key in PLACE},
        "load.force_N": by_force,
        "film.thickness_um": by_thickness,
        "film.temperature_change_K": by_temperature,
        **{key: partial(by_modulus, key) for key in _moduli(film)},
        "film.d31_pC_N": lambda: 1e-12 * adjoint.forces[:, 0],
        "film.d32_pC_N": lambda: 1e-12 * adjoint.forces[:, 1],
    }


def _stiffness_rate(film: Film, key: str) -> Array:
    """Derivative of the film's stiffness in Pa per unit of the key, (3, 3)."""
    modulus = film.youngs_modulus_GPa
    E = np.array(modulus if isinstance(modulus, tuple) else (modulus, modulus), dtype=complex)
    nu12 = complex(film.poisson_ratio)
    if key == "film.poisson_ratio":
        nu12 += 1j * COMPLEX_STEP
    else:
        E[{"0": [0], "1": [1]}.get(key[-1], [0, 1])] += 1j * COMPLEX_STEP
    return 1e9 * plane_stress(E[0], E[1], nu12, film.shear_modulus_GPa).imag / COMPLEX_STEP


def _swept(adjoint: _Adjoint, key: str) -> Array:
    """The integral p ∮ (λ · t) (V · n) ds in C per unit of the key, (electrodes,)."""
    probe, load = adjoint.scene.probe, adjoint.equilibrium.load
    assert probe is not None
    space = adjoint.equilibrium.space
    inner, outer, normals = _traces(space, load.patch)
    # traces of the displacement gradient from both sides differ by the discretisation error
    F = IDENTITY + 0.5 * sum(_gradient(side, space, adjoint.x) for side in (inner, outer))
    shapes = shape_values(space.basis.elem, inner.points)
    nodal = adjoint.dofs.reshape(-1, 3, adjoint.dofs.shape[1])[space.nodes[inner.elements]]
    works = np.einsum("fqa,facn,fqc->fqn", shapes, nodal, load.direction(F))
    points = np.moveaxis(space.mesh.mapping().F(inner.points, inner.elements), 0, -1)
    swept = inner.weights * (_velocity(probe, key, points) * normals).sum(axis=-1)
    return load.pressure * np.einsum("fq,fqn->n", swept, works)


def _traces(space: Space, patch: Indices) -> tuple[PlacedQuadrature, PlacedQuadrature, Array]:
    """Quadrature on a patch's outline, in the elements inside and outside, and normals outwards.

    Normals are (edges, points, 2). Where the outline is the clamped rim, λ is zero and nothing is
    swept.
    """
    mesh = space.mesh
    facets, count = np.unique(mesh.t2f[:, patch], return_counts=True)
    facets = facets[(count == 1) & (mesh.f2t[1, facets] >= 0)]
    pair = mesh.f2t[:, facets]
    inside, outside = np.where(np.isin(pair[0], patch), pair, pair[::-1])
    (inner, tangents), (outer, _) = (
        facet_quadrature(mesh, facets, elements, EDGE_POINTS) for elements in (inside, outside)
    )
    normals = np.stack([tangents[..., 1], -tangents[..., 0]], axis=-1)
    middle = mesh.p[:, mesh.t[:, inside]].mean(axis=1).T[:, None]
    outwards = np.moveaxis(mesh.mapping().F(inner.points, inside), 0, -1) - middle
    normals *= np.sign((normals * outwards).sum(axis=-1, keepdims=True))
    return inner, outer, normals


def _gradient(side: PlacedQuadrature, space: Space, x: Array) -> Array:
    """Displacement gradient (edges, points, 3, 2) of the dofs `x`."""
    nodal = x.reshape(-1, 3)[space.nodes[side.elements]][:, None]
    return np.matmul(nodal.swapaxes(2, 3), space.gradients_at(side.elements, side.points))


def _velocity(probe: Probe, key: str, points: Array) -> Array:
    """Velocity of a probe's points (..., 2) in m, in m per unit of the key."""
    if key != "probe.rotation_deg":
        return np.full_like(points, 1e-3 * np.eye(2)[PLACE.index(key)])
    x, y = np.moveaxis(points - 1e-3 * np.array([probe.x_mm, probe.y_mm]), -1, 0)
    return np.radians(1.0) * np.stack([-y, x], axis=-1)
