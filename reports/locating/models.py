"""Response models of the thesis's sensors, built once and kept.

One model per probe and film has the electrodes of both of the thesis's layouts, by their direction
from the film's centre in degrees; one of them belongs to both.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from pvdf_fem import Scene
from pvdf_fem.reporting.crossings import Contours
from pvdf_fem.response.build import build_response
from pvdf_fem.response.model import Domain, Model
from pvdf_fem.response.response import Response
from pvdf_fem.response.response_file import response_key
from pvdf_fem.sweeps.store import key
from reports.common.results import MATERIAL, Results

Array = NDArray[np.float64]

#: Relative error of the finite-element charges.
TOLERANCE = 5e-6
#: Largest error bound of a model.
MODEL_TOLERANCE = 2e-4
#: A probe that the thesis has not, and which no turning changes.
DISC = "disc"
REACH_MM = 12.0
FORCES_N = (0.1, 5.0)
_RING_MM, _SIDE_MM = 10.0, 3.0
_PROBES: dict[str, dict[str, Any]] = {
    "triangle": {"shape": "triangle", "side_mm": 7.0},
    "rectangle": {"shape": "rectangle", "width_mm": 14.0, "height_mm": 7.0},
    DISC: {"shape": "circle", "radius_mm": 4.0},
}
#: d31 and d32 in pC/N.
_FILMS = {"biaxial": (8.0, 8.0), "uniaxial": (18.0, 2.0)}
#: Direction of each electrode from the film's centre in degrees, by the layout.
_DIRECTIONS_DEG = {
    "three": {"A": -90, "B": 30, "C": 150},
    "four": {"A": 0, "B": 90, "C": 180, "D": -90},
}
_ALL_DEG = sorted({d for layout in _DIRECTIONS_DEG.values() for d in layout.values()})
#: Positions that the thesis recovers.
PRINTED = Path(__file__).parents[1] / "thesis" / "positions.csv"


@dataclass(frozen=True)
class Position:
    """A touch of the thesis, and the error of its recovered place, NaN where there is none."""

    case: str
    layout: str
    probe: str
    film: str
    touch: tuple[float, float, float, float]  #: x and y in mm, rotation in degrees, force in N.
    error_mm: float


def printed_positions() -> list[Position]:
    """All positions that the thesis recovers, simulated and measured."""
    table = pd.read_csv(PRINTED)
    films = {d[0]: name for name, d in _FILMS.items()}
    return [
        Position(
            f"{row['table']} row {row['row']}, {row['electrodes.layout']} electrodes",
            str(row["electrodes.layout"]),
            str(row["probe.shape"]),
            films[row["film.d31_pC_N"]],
            (row["x_mm"], row["y_mm"], row["rotation_deg"], row["force_N"]),
            row["error_mm"],
        )
        for row in table.to_dict("records")
    ]


def sensor(probe: str, film: str = "biaxial") -> Scene:
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
    d = dict(zip(("film.d31_pC_N", "film.d32_pC_N"), _FILMS[film], strict=True))
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
    return {name: str(direction) for name, direction in _DIRECTIONS_DEG[layout].items()}


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
    built_from = response_key(scene, Domain(reach_mm, forces_N), MODEL_TOLERANCE)
    path = folder / f"{key(scene)[:12]}-{built_from[:12]}.response"
    if path.exists():
        return Response.load(path)
    return build_response(scene, reach_mm, forces_N, MODEL_TOLERANCE, processes, file=path)


def scene_at(probe: str, film: str, touch: ArrayLike) -> Scene:
    """The scene of a touch (4,), whose charges a model is compared with."""
    x, y, rotation, force = (round(float(value), 9) for value in np.asarray(touch))
    place = {"probe.x_mm": x, "probe.y_mm": y, "probe.rotation_deg": rotation}
    accurate = {"load.force_N": force, "numerics.tolerance": TOLERANCE}
    return sensor(probe, film).with_(**place, **accurate)


def charges_of(results: Results, scene: Scene, electrodes: Mapping[str, str]) -> list[float]:
    """Charges in pC of a solved scene."""
    film, record = scene.film, results[scene]
    charges = record.charges_pC(film.d31_pC_N, film.d32_pC_N, MATERIAL)
    return [charges[own] for own in electrodes.values()]


@dataclass(frozen=True, eq=False)
class Held:
    """The charges of a model over the probe's place, its rotation and force held: a map, in which
    contours are sought."""

    model: Model
    electrodes: Mapping[str, str]
    rotation_deg: float
    force_N: float

    @property
    def names(self) -> tuple[str, ...]:
        """The thesis's names of the electrodes."""
        return tuple(self.electrodes)

    @property
    def domain(self) -> Domain:
        """The model's."""
        return self.model.domain

    def charges(self, places_mm: Array) -> Array:
        """Charges (n, electrodes) in pC at places (n, 2); beyond the reach those at its edge."""
        distance = np.linalg.norm(places_mm, axis=1, keepdims=True)
        inner = places_mm * np.minimum(1.0, self.domain.reach_mm / np.maximum(distance, 1e-9))
        held = np.broadcast_to([self.rotation_deg, self.force_N], inner.shape)
        charges, _ = self.model.evaluate(np.concatenate([inner, held], axis=1))
        return charges[:, rows_of(self.model, self.electrodes)]


def triangulated_mm(
    model: Model,
    electrodes: Mapping[str, str],
    charges_pC: Array,
    rotation_deg: float,
    force_N: float,
) -> Array:
    """The thesis's place (2,) of charges, in the order of the electrodes; NaN if there is none."""
    charges = dict(zip(electrodes, charges_pC.tolist(), strict=True))
    return Contours(Held(model, electrodes, rotation_deg, force_N)).place_mm(charges)
