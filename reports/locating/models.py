"""Response models of the thesis's sensors, built once and kept.

One model per probe and film has the electrodes of both of the thesis's layouts, by their direction
from the film's centre in degrees; one of them belongs to both.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pvdf_fem import Scene
from pvdf_fem.response.build import build_response
from pvdf_fem.response.model import Domain, Model
from pvdf_fem.response.response import Response
from pvdf_fem.response.response_file import response_key
from reports.chapters.calibration import DIRECTIONS_DEG
from reports.common.results import MATERIAL, Results
from reports.common.thesis_data import Thesis
from reports.common.thesis_scene import PROBES
from reports.maps.isocharge import contour
from reports.thesis_methods.triangulation import triangulate

Array = NDArray[np.float64]

#: Relative error of the finite-element charges.
TOLERANCE = 5e-6
#: A probe that the thesis has not, and which no turning changes.
DISC = "disc8"
REACH_MM = 12.0
FORCES_N = (0.1, 5.0)
_RING_MM, _SIDE_MM = 10.0, 3.0
# Between points of a contour.
_STEP_MM = 1.0
_PROBES = {**PROBES, DISC: {"shape": "circle", "radius_mm": 4.0}}
_ALL_DEG = sorted({d for layout in DIRECTIONS_DEG.values() for d in layout.values()})


def sensor(thesis: Thesis, probe: str, film: str = "biaxial") -> Scene:
    """The scene of a model: both layouts' electrodes, the thesis's follower pressure."""
    directions = np.radians(_ALL_DEG)
    electrodes = [
        {
            "name": str(direction),
            "x_mm": round(_RING_MM * float(np.cos(angle)), 9),
            "y_mm": round(_RING_MM * float(np.sin(angle)), 9),
            "side_mm": _SIDE_MM,
        }
        for direction, angle in zip(_ALL_DEG, directions, strict=True)
    ]
    d = {f"film.{k}_pC_N": thesis.parameters["film"][film][k]["value"] for k in ("d31", "d32")}
    return Scene().with_(
        **{
            "electrodes": electrodes,
            "probe": _PROBES[probe],
            "load.kind": "follower",
            "numerics.observable": MATERIAL,
            **d,
        }
    )


def electrodes_of(layout: str) -> dict[str, str]:
    """The models' name of each electrode of a layout, by the thesis's name."""
    return {name: str(direction) for name, direction in DIRECTIONS_DEG[layout].items()}


def rows_of(model: Model, electrodes: Mapping[str, str]) -> list[int]:
    """Places of electrodes in the model's charges."""
    return [model.names.index(name) for name in electrodes.values()]


def distance_mm(values: Array, touch: Array) -> float:
    """Between the places of two touches (4,)."""
    return float(np.hypot(*(values - touch)[:2]))


def response_of(
    scene: Scene,
    folder: Path,
    processes: int,
    reach_mm: float = REACH_MM,
    forces_N: tuple[float, float] = FORCES_N,
) -> Response:
    """The model of a scene, from its file in the folder or built and written there."""
    path = folder / f"{response_key(scene, Domain(reach_mm, forces_N))[:24]}.response"
    if path.exists():
        return Response.load(path)
    model = build_response(scene, reach_mm=reach_mm, force_N=forces_N, processes=processes)
    model.save(path)
    return model


def scene_at(thesis: Thesis, probe: str, film: str, touch: Array) -> Scene:
    """The scene of a touch (4,), whose charges a model is compared with."""
    x, y, rotation, force = (round(float(value), 9) for value in touch)
    place = {"probe.x_mm": x, "probe.y_mm": y, "probe.rotation_deg": rotation}
    accurate = {"load.force_N": force, "numerics.tolerance": TOLERANCE}
    return sensor(thesis, probe, film).with_(**place, **accurate)


def charges_of(results: Results, scene: Scene, electrodes: Mapping[str, str]) -> list[float]:
    """Charges in pC of a solved scene."""
    film, record = scene.film, results[scene]
    charges = record.charges_pC(film.d31_pC_N, film.d32_pC_N, MATERIAL)
    return [charges[own] for own in electrodes.values()]


@dataclass(frozen=True, eq=False)
class Layered:
    """The charge of one electrode by the probe's place, its rotation and force held.

    What a triangulation needs of a model.
    """

    model: Model
    electrode: str
    rotation_deg: float
    force_N: float

    @property
    def reach_mm(self) -> float:
        """The model's."""
        return self.model.domain.reach_mm

    def value_and_gradient(self, positions_mm: Array) -> tuple[Array, Array]:
        """Charges in pC, (n,), and gradients in pC/mm, (n, 2), at positions (n, 2).

        Beyond the reach linear continuations along the radius, which contours end before.
        """
        distance = np.linalg.norm(positions_mm, axis=1)
        inner = positions_mm * np.minimum(1.0, self.reach_mm / np.maximum(distance, 1e-9))[:, None]
        held = np.broadcast_to([self.rotation_deg, self.force_N], inner.shape)
        charges, slopes = self.model.evaluate(np.concatenate([inner, held], axis=1))
        k = self.model.names.index(self.electrode)
        slope = slopes[:, k, :2]
        beyond = np.einsum("ni,ni->n", slope, positions_mm - inner)
        return charges[:, k] + beyond, slope


def triangulated_mm(
    model: Model,
    electrodes: Mapping[str, str],
    charges_pC: Array,
    rotation_deg: float,
    force_N: float,
) -> Array:
    """The thesis's place (2,) of charges, in the order of the electrodes; NaN if there is none."""
    contours = [
        contour(name, Layered(model, own, rotation_deg, force_N), charge, _STEP_MM)
        for (name, own), charge in zip(electrodes.items(), charges_pC.tolist(), strict=True)
    ]
    return triangulate(contours).position_mm
