"""What coupling, heat, air, the thickness direction and what is glued on do to measured charges.

Every change is that of one scene against another on the same mesh, so that meshes do not matter.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pvdf_fem import Scene, respond, solve
from pvdf_fem.solvers.status import Status

Array = NDArray[np.float64]
Job = Callable[[], Array]


@dataclass(frozen=True)
class Conditions:
    """What the scenes of the changes have.

    Attributes
    ----------
    d33_pC_N : float
        Charge per stress across the film.
    pyroelectric_uC_m2K : float
        Of the thesis's App. 1, with the sign of PVDF's.
    contact_s : float
        How long a warm probe touches: half a period at 20 Hz.
    frequency_Hz, forces_N
        Frequency at which charges are read, and the mean forces about which the probe oscillates.
    overlap_mm, tape_um, tape_GPa : float
        How far tapes reach over the outer edges of electrodes, their thickness on both sides
        together, and their modulus.
    """

    d33_pC_N: float = -15.0
    pyroelectric_uC_m2K: float = -25.0
    contact_s: float = 0.025
    frequency_Hz: float = 20.0
    forces_N: tuple[float, ...] = (0.05, 0.2, 1.0)
    overlap_mm: float = 1.0
    tape_um: float = 100.0
    tape_GPa: float = 3.0


CONDITIONS = Conditions()


@dataclass(frozen=True, eq=False)
class TransducerChanges:
    """Logarithms of charges over those of the scene without an effect, each by electrode.

    Attributes
    ----------
    across, open, warm : ndarray, shape (electrodes,)
        For the `Conditions`' d33, for open electrodes, and for a probe that is 1 K warmer.
    air : ndarray, shape (forces, electrodes)
        For oscillations in air, against slow ones, about the mean forces.
    covered : ndarray, shape (electrodes,)
        For tapes that overlap the electrodes.
    varied : ndarray, shape (4, electrodes)
        Slopes by the rim's displacements cos θ, sin θ, cos 3θ, sin 3θ, over the one by which the
        simulated cooling stretches the film.
    """

    across: Array
    open: Array
    warm: Array
    air: Array
    covered: Array
    varied: Array


def transducer_changes(
    scene: Scene, workers: Callable[[Sequence[Job]], list[Array]]
) -> TransducerChanges:
    """The changes of a measured scene; `workers` runs functions, perhaps in several processes."""
    c = CONDITIONS
    pyroelectric: dict[str, Any] = {"film.pyroelectric_uC_m2K": c.pyroelectric_uC_m2K}
    warm = {"probe.temperature_K": 1.0, "probe.contact_time_s": c.contact_s, **pyroelectric}
    changed: tuple[dict[str, Any], ...] = (
        {"film.d33_pC_N": c.d33_pC_N},
        {"film.coupling": True, "readout.kind": "voltage"},
        warm,
        {"film.patches": tapes(scene, c.overlap_mm)},
    )
    jobs: list[Job] = [partial(_change, scene.with_(**tables), scene) for tables in changed]
    jobs += [partial(air, scene, force) for force in c.forces_N]
    jobs += [partial(_change, *_displaced(scene, term)) for term in (1, 2, 5, 6)]
    across, open_, heat, covered, *others = workers(jobs)
    oscillating, varied = np.split(np.array(others), [len(c.forces_N)])
    return TransducerChanges(across, open_, heat, oscillating, covered, varied)


def solved_charges(scene: Scene, mesh: Any = None) -> Array:
    """Charges in pC of a scene; `RuntimeError` where it does not converge."""
    return _charges(scene, mesh)[0]


def _charges(scene: Scene, mesh: Any) -> tuple[Array, Any]:
    solution = solve(scene, mesh=mesh)
    if solution.status is not Status.CONVERGED:
        raise RuntimeError(f"a scene did not converge: {solution.status}")
    return np.array(list(solution.charges_pC.values())), solution.mesh


def _change(changed: Scene, plain: Scene) -> Array:
    charges, mesh = _charges(changed, None)
    return np.log(charges / solved_charges(plain, mesh))


def air(scene: Scene, force_N: float) -> Array:
    """Logarithms of charges of a small force that oscillates about another one, over slow ones."""
    in_air = scene.with_(air={"baffle": True}, **{"load.force_N": force_N})
    charges = respond(in_air, [0.0, CONDITIONS.frequency_Hz]).charges_pC_N.values()
    slow, fast = np.abs(list(charges)).T
    return np.asarray(np.log(fast / slow))


def tapes(scene: Scene, overlap_mm: float) -> list[dict[str, Any]]:
    """Patches over the outer part of each electrode, with edges along the radius."""
    glued = {"thickness_um": CONDITIONS.tape_um, "both_sides": True}
    glued |= {"youngs_modulus_GPa": CONDITIONS.tape_GPa, "poisson_ratio": 0.3}
    patches = []
    for electrode in scene.electrode_list:
        x, y = electrode.x_mm, electrode.y_mm
        side = 1e3 * float(np.sqrt(electrode.outline.area))
        outwards = 1.0 + 0.5 * (side - overlap_mm) / float(np.hypot(x, y))
        place = {"x_mm": x * outwards, "y_mm": y * outwards}
        turn = {"rotation_deg": float(np.degrees(np.arctan2(y, x)))}
        sizes = {"width_mm": overlap_mm, "height_mm": side}
        patches.append({"shape": "rectangle", **place, **turn, **sizes, **glued})
    return patches


def rim_displaced(scene: Scene, term: int, times: float = 0.5) -> dict[str, Any]:
    """A displacement of the rim in a term of its series, over that of the simulated stretch."""
    stretch_um = 1e3 * scene.film.radius_mm * float(scene.film.strain_at_rest[0])
    outwards = [0.0] * 7
    outwards[term] = times * stretch_um
    return {"film.rim_displacement_um": outwards}


def _displaced(scene: Scene, term: int) -> tuple[Scene, Scene]:
    """The scene with half a stretch by the rim's displacement in a term, and with minus that."""
    there, back = (scene.with_(**rim_displaced(scene, term, t)) for t in (0.5, -0.5))
    return there, back
