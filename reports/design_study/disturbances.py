"""Air, tapes and a displaced rim, as changes of a scene or of its charges."""

from __future__ import annotations

from typing import Any

import numpy as np

from pvdf_fem import Scene, respond
from pvdf_fem.arrays import Array

FREQUENCY_HZ = 20.0  #: At which charges are read.
#: Thickness in µm of tapes on both sides together, and their modulus in GPa.
TAPE_UM, TAPE_GPA = 100.0, 3.0


def air(scene: Scene, force_N: float) -> Array:
    """Logarithms of charges of a small force that oscillates about another one, over slow ones."""
    in_air = scene.with_(air={"baffle": True}, **{"load.force_N": force_N})
    charges = respond(in_air, [0.0, FREQUENCY_HZ]).charges_pC_N.values()
    slow, fast = np.abs(list(charges)).T
    return np.asarray(np.log(fast / slow))


def tapes(scene: Scene, overlap_mm: float) -> list[dict[str, Any]]:
    """Patches over the outer part of each electrode, with edges along the radius."""
    glued = {"thickness_um": TAPE_UM, "both_sides": True}
    glued |= {"youngs_modulus_GPa": TAPE_GPA, "poisson_ratio": 0.3}
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
