"""Films that a scene file cannot describe: unevenly stretched, or stiffened by tapes.

A tape is a patch of the mesh whose stiffness per unit length is a multiple of the film's. It is put
into the scene as one more electrode, so that the mesh has its outline; it collects no charge that
anyone reads.

`film.patches` describe such tapes too; of an adhesive and of a copper tape their charges are within
1 and 3 % of these. They do not replace these films: where film and tape are 30 times as stiff as
the film, `solve` ends as unstable, since its meshes are fine enough for the film to wrinkle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pvdf_fem import Scene
from pvdf_fem.charges.forces import electrode_forces
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.membrane import Membrane
from pvdf_fem.film.space import Space
from pvdf_fem.film.term import State
from pvdf_fem.mesh.gmsh_mesh import electrode_patch, mesh_scene
from pvdf_fem.scene.film import Film
from pvdf_fem.solution.first_sizes import ORDER, first_sizes
from pvdf_fem.solvers.budget import Budget
from pvdf_fem.solvers.newton import DeferredNewton, NewtonOptions, newton
from pvdf_fem.solvers.seed import seed
from pvdf_fem.solvers.status import Status

Array = NDArray[np.float64]

#: First word of the names of electrodes that are tapes.
TAPE = "tape"


class UnevenMembrane(Membrane):
    """A membrane with any free strain, and patches that are stiffer than the film.

    Parameters
    ----------
    space, film
        As for `Membrane`.
    free_strain : ndarray, shape (3,), or None
        Strain at which there is no stress, Voigt; by default the film's.
    factors : mapping
        Stiffness over the film's on the patch of an electrode, by the electrode's name.
    """

    def __init__(
        self,
        space: Space,
        film: Film,
        free_strain: Array | None,
        factors: Mapping[str, float],
    ) -> None:
        super().__init__(space, film)
        if free_strain is not None:
            self.strain_at_rest = -free_strain
        # Thickness and stiffness enter the energy only as a product with the volumes.
        for name, factor in factors.items():
            self.volumes[space.mesh.subdomains[electrode_patch(name)]] *= factor

    def residual(self, state: State) -> Array:
        """The whole residual, since the flat film is not in balance where the stiffness steps."""
        return self.internal_forces(state)


def taped(
    scene: Scene,
    width_mm: float = 5.0,
    gap_mm: float = 0.2,
    rim_mm: float = 0.5,
    tolerance: float = 1e-3,
) -> Scene:
    """The scene with a tape outside of each electrode, a strip along the radius to the rim.

    Parameters
    ----------
    scene : Scene
        A scene whose electrodes are squares of 3 mm along the radius, as the thesis's four.
    width_mm : float
        Width of a tape.
    gap_mm, rim_mm : float
        Distances of a tape's ends from the electrode's edge and from the rim.
    tolerance : float
        Tolerance that sets the mesh, see `uneven_charges`.
    """
    electrodes = [electrode.model_dump(mode="json") for electrode in scene.electrode_list]
    for electrode in scene.electrode_list:
        away = np.array([electrode.x_mm, electrode.y_mm])
        along = away / np.linalg.norm(away)
        begin = float(along @ away) + 1.5 + gap_mm
        length = scene.film.radius_mm - rim_mm - begin
        middle = (begin + 0.5 * length) * along
        tape = {
            "name": f"{TAPE} {electrode.name}",
            "shape": "rectangle",
            "x_mm": round(float(middle[0]), 9),
            "y_mm": round(float(middle[1]), 9),
            "width_mm": length,
            "height_mm": width_mm,
            "rotation_deg": round(float(np.degrees(np.arctan2(along[1], along[0]))), 9),
        }
        electrodes.append(tape)
    return scene.with_(electrodes=electrodes, **{"numerics.tolerance": tolerance})


def uneven_charges(
    scene: Scene,
    free_strain: Array | None = None,
    factors: Sequence[float] = (1.0,),
    taped_order: int = 1,
) -> Array:
    """Charges in pC of a scene's electrodes that are no tapes, (factors, electrodes).

    A film without bending wrinkles at the corners of stiff tapes, where fine meshes find no stable
    equilibrium. Linear displacements on a coarser mesh find one; the ratios of their charges with
    tapes to those without agree to 1.5 % with those of quadratic displacements, where these
    converge.

    Parameters
    ----------
    scene : Scene
        Electrodes whose name begins with ``tape`` are tapes.
    free_strain : ndarray, shape (3,), optional
        Strain at which there is no stress; by default the film's thermal strain.
    factors : sequence of float
        Stiffness of film and tape over that of the film. Each solve starts from the one before,
        so they should grow.
    taped_order : int
        Order of the displacements on a film with tapes.

    Raises
    ------
    RuntimeError
        When Newton's method does not converge.
    """
    electrodes = scene.electrode_list
    tapes = [e.name for e in electrodes if e.name.startswith(TAPE)]
    order = taped_order if tapes else ORDER
    equilibrium = Equilibrium(scene, mesh_scene(scene, first_sizes(scene, order)), order)
    read = [i for i, e in enumerate(electrodes) if e.name not in tapes]
    q, charges, budget = seed(equilibrium), [], Budget.of(scene)
    for factor in factors:
        stiffer = dict.fromkeys(tapes, factor)
        uneven = UnevenMembrane(equilibrium.space, scene.film, free_strain, stiffer)
        equilibrium = equilibrium.with_terms([uneven, *equilibrium.terms[1:]])
        result = newton(DeferredNewton(equilibrium, NewtonOptions(), budget, near=False), q)
        if result.status is not Status.CONVERGED:
            raise RuntimeError(f"tapes {factor:g} times as stiff: {result.status}")
        q = result.q
        forces = electrode_forces(scene, equilibrium.membrane, equilibrium.unknowns.expand(q))
        charges.append(1e12 * (forces @ [scene.film.d31, scene.film.d32])[read])
    return np.array(charges)
