"""Films that a scene file cannot describe: unevenly stretched, or stiffened by tapes.

A tape is a patch of the mesh whose stiffness per unit length is a multiple of the film's. It is put
into the scene as one more electrode, so that the mesh has its outline; it collects no charge that
anyone reads.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from skfem import MeshTri2

from pvdf_fem import Scene
from pvdf_fem.charges.forces import electrode_forces
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.membrane import Membrane, MembraneState
from pvdf_fem.mesh.gmsh_mesh import electrode_patch, mesh_scene
from pvdf_fem.scene.film import Film
from pvdf_fem.solution.first_sizes import ORDER, first_sizes
from pvdf_fem.solvers.newton import Status, newton, seed

Array = NDArray[np.float64]

# Film without bending wrinkles at the corners of stiff tapes, where fine meshes find no stable
# equilibrium. Linear displacements on a coarser one do; their charges with tapes over those without
# agree to 1.5 % with those of quadratic ones where these converge.
TAPED_ORDER, TAPED_TOLERANCE = 1, 1e-3
TAPE = "tape"
#: A tape as wide as this begins so far outside of its electrode's edge and ends so far from the
#: rim, all in mm.
WIDTH_MM, GAP_MM, RIM_MM = 5.0, 0.2, 0.5


class UnevenMembrane(Membrane):
    """A membrane with any free strain, and patches that are stiffer than the film.

    Parameters
    ----------
    mesh, film, order
        As for `Membrane`.
    free_strain : ndarray, shape (3,)
        The strain without stress, Voigt: α ΔT (1, 1, 0) for an evenly cooled film.
    factors : mapping
        By electrode's name, stiffness over the film's on that patch.
    """

    def __init__(
        self,
        mesh: MeshTri2,
        film: Film,
        order: int,
        free_strain: Array,
        factors: Mapping[str, float],
    ) -> None:
        super().__init__(mesh, film, order)
        self.free_strain = free_strain
        # thickness and stiffness enter the energy as a product with the weights
        self.weights = self.weights.copy()
        for name, factor in factors.items():
            self.weights[self.mesh.subdomains[electrode_patch(name)]] *= factor

    def elastic(self, strain: Array) -> Array:
        """Strain without the free one."""
        return strain - self.free_strain

    def added_residual(self, state: MembraneState) -> Array:
        """The whole residual: where the stiffness steps, the flat film is not in balance."""
        return self.residual(state)


def taped(scene: Scene) -> Scene:
    """The scene with the outline of a tape outside of each of the thesis's four electrodes.

    A strip from the electrode to the rim, along the radius.
    """
    found = [electrode.model_dump(mode="json") for electrode in scene.electrode_list]
    for electrode in scene.electrode_list:
        away = np.array([electrode.x_mm, electrode.y_mm])
        along = away / np.linalg.norm(away)
        begin = float(along @ away) + 1.5 + GAP_MM
        length = scene.film.radius_mm - RIM_MM - begin
        middle = (begin + 0.5 * length) * along
        tape = {
            "name": f"{TAPE} {electrode.name}",
            "shape": "rectangle",
            "x_mm": round(float(middle[0]), 9),
            "y_mm": round(float(middle[1]), 9),
            "width_mm": length,
            "height_mm": WIDTH_MM,
            "rotation_deg": round(float(np.degrees(np.arctan2(along[1], along[0]))), 9),
        }
        found.append(tape)
    return scene.with_(electrodes=found, **{"numerics.tolerance": TAPED_TOLERANCE})


def uneven_charges(
    scene: Scene, free_strain: Array | None = None, factors: Sequence[float] = (1.0,)
) -> Array:
    """Charges in pC of a scene's electrodes that are no tapes, (factors, electrodes).

    Parameters
    ----------
    scene : Scene
        Tapes in it are those electrodes whose name begins with ``tape``.
    free_strain : ndarray, shape (3,), optional
        By default that of the film.
    factors : sequence of float
        Stiffness of film and tape over that of the film. Each solve starts from the one before,
        so they should grow.

    Raises
    ------
    RuntimeError
        When Newton's method does not converge.
    """
    electrodes = scene.electrode_list
    tapes = [e.name for e in electrodes if e.name.startswith(TAPE)]
    order = TAPED_ORDER if tapes else ORDER
    equilibrium = Equilibrium(scene, mesh_scene(scene, first_sizes(scene, order)), order)
    if free_strain is None:
        free_strain = scene.film.thermal_strain * np.array([1.0, 1.0, 0.0])
    mine = [i for i, e in enumerate(electrodes) if e.name not in tapes]
    mesh, q, found = equilibrium.membrane.mesh, seed(equilibrium), []
    for factor in factors:
        stiffer = dict.fromkeys(tapes, factor)
        equilibrium.membrane = UnevenMembrane(mesh, scene.film, order, free_strain, stiffer)
        result = newton(equilibrium, q)
        if result.status is not Status.CONVERGED:
            raise RuntimeError(f"tapes {factor:g} times as stiff: {result.status}")
        q = result.q
        forces = electrode_forces(scene, equilibrium.membrane, equilibrium.unknowns.expand(q))
        found.append(1e12 * (forces @ [scene.film.d31, scene.film.d32])[mine])
    return np.array(found)
