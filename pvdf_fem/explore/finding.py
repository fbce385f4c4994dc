"""What `locate` says of the charges of a scene: the likely touches with their ellipses.

Until there is a response of film and probe, touches are located by full solves, which takes some
seconds. With a response there are also isocharge lines: the places of the probe where an electrode
would have the charge that it has.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import contourpy
import numpy as np

from pvdf_fem.arrays import Array, polar_grid
from pvdf_fem.output.touch_map import deviation_ellipse
from pvdf_fem.readout.channel import channels
from pvdf_fem.response.build import build_response
from pvdf_fem.response.model import Domain, Model, centred, touch_of, wanted_model
from pvdf_fem.response.response import Response
from pvdf_fem.response.response_file import response_key
from pvdf_fem.scene.scene import Scene
from pvdf_fem.told import Grid
from pvdf_fem.touch.locate import locate

TOLERANCE = 1e-2  #: Error bound of the response that is built for the page.
LINE_STEP_MM = 0.5  #: Distance of the places between which isocharge lines are interpolated.


class Found(NamedTuple):
    """Touches that explain the charges of a scene, and where its electrodes have these charges."""

    #: Ellipses of one standard deviation in mm, (n, 2), with the weights of their touches.
    ellipses: list[tuple[Array, float]]
    #: Isocharge lines in mm, (n, 2), by electrode.
    lines: dict[str, list[Array]]
    #: How the touches were found, and what keeps the first from being the answer.
    remarks: tuple[str, ...]
    table: Grid = Grid((), ())  #: The touches with their standard deviations and weights.


def _found(touches: Sequence[dict[str, Any]], lines: dict[str, Any], *remarks: str) -> Found:
    """Of touches as JSON: quantities by name, or by key of a scene with several probes."""
    places = [(touch, key) for touch in touches for key in touch if key.endswith("x_mm")]
    ellipses = [(deviation_ellipse(touch, key), touch["weight"]) for touch, key in places]
    rows, names = [], list(touches[0]["standard_deviations"]) if touches else []
    for touch in touches:
        cells = (f"{touch[key]:.4g} ± {touch['standard_deviations'][key]:.2g}" for key in names)
        rows.append((f"{100.0 * touch['weight']:.3g} %", *cells))
    return Found(ellipses, lines, remarks, Grid(("likely", *names), (*rows,)))


def domain_of(scene: Scene) -> Domain:
    """Touches of the response that is built for a scene."""
    return wanted_model(scene)[0]


def response_file(scene: Scene, folder: Path) -> Path | None:
    """The file of a scene's response in a folder; None where no response can be built."""
    try:
        return folder / response_key(scene, domain_of(scene), TOLERANCE)
    except ValueError:  # of several probes, and of loads that are no force
        return None


def build(scene: Scene, file: Path) -> Path:
    """Build the response of a scene and write its file, which is returned."""
    domain = domain_of(scene)
    limits = domain.reach_mm, domain.force_N, TOLERANCE
    build_response(centred(scene), *limits, processes=1, file=file, progress=False)
    return file


def find(scene: Scene, result: Mapping[str, Any], noise: float, file: Path | None) -> Found:
    """The likely touches of a scene by its result, with the response in a file if there is one.

    Readings are changes of charges where the scene's readout reads these, else charges. `noise` is
    their standard deviation, relative to them, to which the readout's is added. Raises ValueError
    for what cannot be located.
    """
    reading = scene.readout.reading if scene.readout else "total"
    charges = result["charge_changes_pC" if reading == "change" else "charges_pC"]
    if charges is None:
        raise ValueError("changes by the touch are not known; the result's warnings say why")
    noise_pC = {c.name: 1e12 * c.noise * c.capacitance / abs(c.gain) for c in channels(scene)}
    how: dict[str, Any] = {"sigma": noise, "noise_pC": noise_pC, "reading": reading}
    scene = scene.with_(stage=None, readout=None)  # places are those of the film
    if file is None:
        found = locate(scene, charges, touches=len(scene.loaded_probes), **how)
        return _found(found.to_json()["touches"], {}, "by full solves", *found.remarks)
    turned = centred(scene).with_(**{"probe.rotation_deg": touch_of(scene)["rotation_deg"]})
    model = _response(file, turned)
    location = locate(model, charges, **how)
    lines = isocharge_lines(model, touch_of(scene), result["charges_pC"])
    told = f"by a response whose charges are off by {100.0 * model.error_bound:.2g} % at most"
    told += ", as are the lines: places of the probe where an electrode has its charge"
    return _found(location.to_json()["touches"], lines, told, *location.remarks)


@lru_cache(maxsize=8)
def _response(file: Path, scene: Scene) -> Response:
    """The response, whose tables are kept with it."""
    return Response.load(file).for_scene(scene, 1)


def isocharge_lines(
    model: Model, touch: Mapping[str, float], charges_pC: Mapping[str, float]
) -> dict[str, list[Array]]:
    """Lines in mm, (n, 2), by electrode: places where a probe that is turned and pressed as in a
    touch would give charges. None for a force that the model does not hold for."""
    (low, high), reach_mm = model.domain.force_N, model.domain.reach_mm
    if not low <= touch["force_N"] <= high:
        return {}
    count = round(2.0 * reach_mm / LINE_STEP_MM)
    x, y = np.moveaxis(polar_grid(reach_mm, count, 3 * count), -1, 0)
    pressed = np.full((2, x.size), [[touch["rotation_deg"]], [touch["force_N"]]])
    charges = model.evaluate(np.stack([x.ravel(), y.ravel(), *pressed], axis=-1))[0]
    lines: dict[str, Any] = {}
    for name, values in zip(model.names, charges.T, strict=True):
        contours = contourpy.contour_generator(x, y, values.reshape(x.shape))
        lines[name] = contours.lines(charges_pC[name])
    return lines
