"""What `locate` says of the charges of a scene: the likely touches with their ellipses.

Until there is a response of film and probe, touches are located by full solves, which takes some
seconds. With a response there are also isocharge lines: the places of the probe where an electrode
would have the charge that it has.
"""

from __future__ import annotations

import glob
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import contourpy
import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.readout.channel import channels
from pvdf_fem.response.build import ResponseOptions, build_response
from pvdf_fem.response.model import QUANTITIES, Domain, centred, touch_of
from pvdf_fem.response.probe_stress import ProbeMesh
from pvdf_fem.response.response import Response
from pvdf_fem.response.response_file import response_key
from pvdf_fem.scene.scene import Scene
from pvdf_fem.touch.by_solves import locate_by_solves
from pvdf_fem.touch.locate import PLACE_AND_FORCE, locate

#: Touches of the response that is built for the page, and those of `pvdf-fem locate`.
DOMAIN = Domain(12.0, (0.1, 5.0))
TOLERANCE = 1e-2  #: Largest error bound of the response that is built for the page.
KEPT_TOLERANCE = 1e-3  #: Error bound of the responses that `pvdf-fem locate` keeps.
LINE_STEP_MM = 0.5  #: Distance of the places between which isocharge lines are interpolated.
#: A coarser response than `pvdf-fem locate` builds, in a fifth of the time.
OPTIONS = ResponseOptions(
    cell=0.2, largest_cell_mm=1.0, held_out=8, elements=ProbeMesh().scaled(1.5)
)


@dataclass(frozen=True, eq=False)
class Found:
    """Touches that explain the charges of a scene, and where its electrodes have these charges."""

    #: As JSON, the likeliest first: quantities by name, or by key of a scene with several probes.
    touches: tuple[dict[str, Any], ...]
    #: How they were found, and what keeps the first from being the answer.
    remarks: tuple[str, ...]
    #: Isocharge lines in mm, (n, 2), by electrode.
    lines: dict[str, list[Array]] = field(default_factory=dict)

    @property
    def ellipses(self) -> list[tuple[Array, float]]:
        """Ellipses of one standard deviation in mm, (n, 2), with the weights of their touches."""
        names = [name for name in self.unknown if name.endswith("x_mm")]
        return [(ellipse(t, name), t["weight"]) for t in self.touches for name in names]

    @property
    def unknown(self) -> tuple[str, ...]:
        """What was sought."""
        return tuple(self.touches[0]["standard_deviations"]) if self.touches else ()

    @property
    def table(self) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
        """Heading and rows of a table of the touches."""
        rows = [
            (
                *(f"{t[name]:.4g} ± {t['standard_deviations'][name]:.2g}" for name in self.unknown),
                f"{100.0 * t['weight']:.3g} %",
            )
            for t in self.touches
        ]
        return (*self.unknown, "likely"), tuple(rows)


def ellipse(touch: Mapping[str, Any], x_name: str, points: int = 73) -> Array:
    """The ellipse in mm, (points, 2), in which a place is with one standard deviation."""
    names = [x_name, x_name.replace("x_mm", "y_mm")]
    rows = [[*touch["standard_deviations"]].index(name) for name in names]
    root = np.linalg.cholesky(np.array(touch["covariance"])[np.ix_(rows, rows)])
    turns = np.linspace(0.0, 2.0 * np.pi, points)
    circle = np.stack([np.cos(turns), np.sin(turns)])
    return [touch[name] for name in names] + (root @ circle).T


def response_file(scene: Scene, file: Path, made: Path) -> Path | None:
    """The file of a scene's response: that of `pvdf-fem locate` beside the scene file where it is
    there, else one in the folder of those made for the page. None where there can be none."""
    try:
        keys = [response_key(scene, DOMAIN, error)[:16] for error in (KEPT_TOLERANCE, TOLERANCE)]
    except ValueError:
        return None
    kept = file.parent.glob(f"{glob.escape(file.stem)}-{keys[0]}.response")
    return next(kept, made / f"{keys[1]}.response")


def build(scene: Scene, file: Path) -> Path:
    """Build the response of a scene and write its file, which is returned."""
    build_response(
        centred(scene), DOMAIN.reach_mm, DOMAIN.force_N, TOLERANCE, 1, file=file, options=OPTIONS
    )
    return file


def find(scene: Scene, result: Mapping[str, Any], noise: float, file: Path | None = None) -> Found:
    """The likely touches of a scene by the charges of its result, with the response in a file.

    `noise` is the standard deviation of readings, relative to them; that of the scene's readout is
    added. Readings are charges, or their changes where the readout reads these. Raises `ValueError`
    for what cannot be located.
    """
    readout = scene.readout
    reading = "change" if readout and readout.reading == "change" else "total"
    charges = result["charge_changes_pC" if reading == "change" else "charges_pC"]
    noise_pC = {c.name: 1e12 * c.noise * c.capacitance / abs(c.gain) for c in channels(scene)}
    how: dict[str, Any] = {"sigma": noise, "noise_pC": noise_pC, "reading": reading}
    scene = scene.with_(stage=None, readout=None)  # places are those of the film
    if file is None:
        by_solves = locate_by_solves(scene, charges, touches=len(scene.loaded_probes), **how)
        touches = tuple(touch.to_json() for touch in by_solves)
        return Found(touches, ("by full solves", *([] if touches else ["no touch fits"])))
    model = _loaded(file).for_scene(scene)
    location = locate(model, charges, unknown=PLACE_AND_FORCE, **how)
    told = f"by a response whose charges are off by {100 * model.error_bound:.2g} % at most"
    json, lines = location.to_json(), isocharge_lines(model, scene, result["charges_pC"])
    return Found(tuple(json["touches"]), (told, *location.remarks), lines)


@lru_cache(maxsize=4)
def _loaded(file: Path) -> Response:
    return Response.load(file)


def isocharge_lines(
    model: Response, scene: Scene, charges_pC: Mapping[str, float]
) -> dict[str, list[Array]]:
    """Lines in mm, (n, 2), by electrode: places where a scene's probe, turned and pressed as it is,
    would give the charge. None for a force that the response does not hold for."""
    touch, (reach_mm, (low, high)) = touch_of(scene), (DOMAIN.reach_mm, DOMAIN.force_N)
    if not low <= touch["force_N"] <= high:
        return {}
    count = round(2.0 * reach_mm / LINE_STEP_MM)
    radii, turns = np.linspace(0.0, reach_mm, count), np.linspace(0.0, 2.0 * np.pi, 3 * count)
    x, y = radii[:, None] * np.cos(turns), radii[:, None] * np.sin(turns)
    touches = np.column_stack([x.ravel(), y.ravel(), np.empty((x.size, len(QUANTITIES) - 2))])
    touches[:, 2:] = touch["rotation_deg"], touch["force_N"]
    fields = model.evaluate(touches)[0].T.reshape(-1, *x.shape)
    return {
        name: contourpy.contour_generator(x, y, values).lines(charges_pC[name])
        for name, values in zip(model.names, fields, strict=True)
    }
