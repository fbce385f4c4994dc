"""Comparison of sensor designs: how well readings determine place and force over the film.

By the Cramér-Rao bound no unbiased estimate of a touch has a smaller covariance than the inverse
of the Fisher information JᵀΣ⁻¹J, with the derivatives J of the charges by place and force and the
covariance Σ of the readings' noise (Kay, Fundamentals of Statistical Signal Processing, 1993,
sections 3.8 and 3.9). `locate` states this bound for the touches that it finds. So the charges of
every place, without noise, are located: the touch at the place has the bound, and other touches
that are as likely make the place ambiguous.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pvdf_fem import __version__
from pvdf_fem.arrays import Array, Mask
from pvdf_fem.inverse.touch.locate import locate
from pvdf_fem.inverse.touch.location import Location
from pvdf_fem.inverse.touch.measurement import Measurement
from pvdf_fem.progress import Progress, show_progress
from pvdf_fem.scene.arguments import SceneLike, as_response, as_scene, coerce
from pvdf_fem.scene.scene import Scene
from pvdf_fem.studies.design_study import PLACE_DIMS, DesignStudy
from pvdf_fem.surrogate.response import Response
from pvdf_fem.surrogate.response_builder import build_response
from pvdf_fem.surrogate.response_key import make_mechanical_key
from pvdf_fem.surrogate.touch_domain import (
    Domain,
    TouchColumn,
    centre_probe,
    choose_default_reach_mm,
    extract_touch,
)

if TYPE_CHECKING:
    import pandas as pd
    import xarray

#: Number of steps between places from the centre to the reach, by default.
DEFAULT_STEPS = 12


class PlaceBound(NamedTuple):
    """How well readings determine a touch; NaN where no search ended at it."""

    place_deviation_mm: float = math.nan
    force_deviation: float = math.nan  #: Over the force.
    ambiguous: float = math.nan  #: 1 if another touch is likely, too, else 0.


#: Variables over places, with their descriptions and units.
MAPS = {
    "place_deviation_mm": ("deviation of the place", "mm"),
    "force_deviation": ("deviation of the force over the force", "1"),
    "ambiguous": ("whether another touch is likely", "1"),
}


class PlaceGrid:
    """A square grid of places, of which those within the reach are assessed."""

    def __init__(self, reach_mm: float, step_mm: float) -> None:
        """Make the grid about the film's centre, with the reach and the step of its places."""
        steps = int(reach_mm / step_mm + 1e-9)
        self.coordinates_mm: Array = np.asarray(step_mm * np.arange(-steps, steps + 1), dtype=float)
        x_mm, y_mm = np.meshgrid(self.coordinates_mm, self.coordinates_mm)
        self.is_inside: Mask = np.hypot(x_mm, y_mm) <= reach_mm  #: (y, x)
        #: Places within the reach, (n, 2).
        self.places_mm: Array = np.column_stack([x_mm[self.is_inside], y_mm[self.is_inside]])


class DesignColumns:
    """Results of designs as arrays."""

    def __init__(self, count: int, grid: PlaceGrid) -> None:
        """Make arrays for a number of designs."""
        self.grid = grid
        shape = (count, *grid.is_inside.shape)
        #: By variable of `MAPS` the values, (designs, y, x), NaN beyond the reach.
        self.maps: dict[str, Array] = {name: np.full(shape, np.nan) for name in MAPS}
        self.response_error_bounds: Array = np.empty(count)

    def fill(self, index: int, response: Response, sigma: float, noise_pC: float | None) -> None:
        """Assess a design at all places within the reach.

        Parameters
        ----------
        index : int
            Index of the design.
        response : Response
            Its response.
        sigma : float
            Relative standard deviation of a reading.
        noise_pC : float, optional
            Absolute standard deviation of a reading in pC.
        """
        bounds = compute_bounds(response, self.grid.places_mm, sigma, noise_pC)
        for name, values in self.maps.items():
            values[index, self.grid.is_inside] = [getattr(bound, name) for bound in bounds]
        self.response_error_bounds[index] = response.error_bound


def design(
    scene: SceneLike,
    vary: Mapping[str, Any],
    sigma: float = 0.01,
    *,
    noise_pC: float | None = None,
    reach_mm: float | None = None,
    step_mm: float | None = None,
    force_range_N: tuple[float, float] = (0.1, 5.0),
    tolerance: float = 1e-2,
    response: Response | Callable[[Scene], Response] | None = None,
    processes: int | None = None,
    progress: Progress | bool | None = None,
) -> xarray.Dataset:
    """Compare designs by how well their readings determine place and force of a touch.

    Parameters
    ----------
    scene : Scene, or anything that `solve` accepts as a scene
        The sensor, its probe and force. The rotation of the probe counts as known.
    vary : mapping of str to sequence
        Keys of the scene with their values, ``{"electrodes.count": [4, 6, 8]}``; the designs are
        all combinations. Where electrode names vary, readout values by electrode have their
        defaults in every design; the attribute ``dropped`` has these keys.
    sigma : float
        Standard deviation of a reading, relative to the total charge or its change by the touch,
        whichever the scene's readout reads.
    noise_pC : float, optional
        Absolute standard deviation of a reading in pC; by default the noise of the readout.
    reach_mm : float, optional
        Largest distance of touches from the centre; by default that of the response, or of the
        smallest film.
    step_mm : float, optional
        Distance of neighbouring places; by default a twelfth of the reach.
    force_range_N : tuple of float
        Least and largest force of touches that may be confused.
    tolerance : float
        Error bound of responses that are built.
    response : Response or callable, optional
        A response for designs whose films deform alike, or a function that returns the response of
        a scene. Designs whose films deform alike share a response; by default each is built.
    processes : int, optional
        Number of processes that build responses; by default one for each core.
    progress : callable or bool, optional
        Called with the numbers of finished and of all designs; or whether these are shown, see
        `pvdf_fem.progress.show_progress`.

    Returns
    -------
    xarray.Dataset
        With a dimension for each key: ``place_deviation_median_mm`` and ``_worst_mm``,
        ``force_deviation_median`` and ``_worst`` over the force, ``ambiguous_share`` of the places,
        and ``scene``, the design as TOML. In addition by ``y_mm`` and ``x_mm``, NaN beyond the
        reach: ``place_deviation_mm``, ``force_deviation``, ``ambiguous``.

    Raises
    ------
    SceneError, ValueError
        If arguments are wrong, with all errors, before anything is solved.
    NotConvergedError
        If a film has no response.

    Notes
    -----
    With the covariance C = (JᵀΣ⁻¹J)⁻¹ of x, y and the force F, the deviation of the place is
    √(Cxx + Cyy), the root mean square of the distance, and that of the force √C_FF / F. Along a
    direction that readings leave undetermined the deviation is the domain's extent, see
    `Touch.covariance`.

    Examples
    --------
    >>> vary = {"electrodes.ring_radius_mm": [8.0, 10.0]}
    >>> data = design("sensor.toml", vary, sigma=0.01, reach_mm=4.0, step_mm=2.0, tolerance=3e-2)
    >>> data.place_deviation_median_mm.to_pandas()
    """
    vary = coerce("vary", vary, dict[str, Any])
    study = DesignStudy.from_scene(as_scene(scene), vary)
    if response is not None and not callable(response):
        response = as_response(response)
    reach_mm = coerce("reach_mm", reach_mm, float | None)
    force_range_N = coerce("force_range_N", force_range_N, tuple[float, float])
    tolerance = coerce("tolerance", tolerance, float)
    if isinstance(response, Response):
        force_range_N = response.domain.force_N
        if reach_mm is None:
            reach_mm = response.domain.reach_mm
    elif reach_mm is None:
        reach_mm = min(choose_default_reach_mm(group.scene) for group in study.groups)
    domain = Domain(reach_mm, force_range_N)
    if step_mm is None:
        step_mm = reach_mm / DEFAULT_STEPS
    errors = [*study.find_errors(domain, step_mm, tolerance, sigma, noise_pC)]
    if errors:
        raise ValueError("\n".join(dict.fromkeys(errors)))

    responses = []
    for group in study.groups:
        responses.append(
            _get_response(
                group.scene,
                response,
                domain,
                tolerance=tolerance,
                processes=processes,
                progress=progress,
            )
        )
    columns = DesignColumns(len(study.scenes), PlaceGrid(reach_mm, step_mm))
    finished = 0
    with show_progress("designs", progress) as show:
        for group, shared_response in zip(study.groups, responses, strict=True):
            for index in group.indices:
                own_response = shared_response.for_scene(
                    study.scenes[index], processes, check=False
                )
                columns.fill(index, own_response, sigma, noise_pC)
                finished += 1
                show(finished, len(study.scenes))
    attributes: dict[str, Any] = {
        "sigma": sigma,
        "noise_pC": noise_pC,
        "reach_mm": reach_mm,
        "step_mm": step_mm,
        "dropped": " ".join(study.dropped),
    }
    return _make_dataset(study, columns, attributes)


def _get_response(
    scene: Scene,
    response: Response | Callable[[Scene], Response] | None,
    domain: Domain,
    *,
    tolerance: float,
    processes: int | None,
    progress: Progress | bool | None,
) -> Response:
    """Return the response of a scene: that of the caller if it serves, or a new one.

    Parameters
    ----------
    scene : Scene
        A scene of the group that the response is for.
    response : Response or callable, optional
        As in `design`.
    domain : Domain
        Reach and forces of a new response.
    tolerance : float
        Its error bound.
    processes, progress
        As in `build_response`.
    """
    if callable(response):
        return response(scene)
    scene_key = make_mechanical_key(scene)
    if response is not None and make_mechanical_key(response.scene) == scene_key:
        return response
    return build_response(
        centre_probe(scene),
        domain.reach_mm,
        domain.force_N,
        tolerance,
        processes,
        progress=progress,
    )


def compute_bounds(
    response: Response, places_mm: Array, sigma: float, noise_pC: float | None
) -> list[PlaceBound]:
    """Compute the bounds at places, by locating their charges without noise.

    Parameters
    ----------
    response : Response
        Charges of the design. Its own error is not counted.
    places_mm : array, (n, 2)
        Places of the probe.
    sigma : float
        Relative standard deviation of a reading.
    noise_pC : float, optional
        Absolute standard deviation of a reading in pC.
    """
    exact = replace(response, error_bound=0.0)
    touch = list(extract_touch(response.scene).values())
    touches = np.tile(touch, (len(places_mm), 1))
    touches[:, : TouchColumn.ROTATION] = places_mm
    measurement = Measurement.from_response(exact, exact.names, sigma, noise_pC, None)
    readings = measurement.to_readings(exact.evaluate(touches)[0])
    bounds = []
    for row, touch_row in zip(readings, touches, strict=True):
        by_electrode = dict(zip(exact.names, row, strict=True))
        location = locate(exact, by_electrode, sigma, noise_pC=noise_pC)
        bounds.append(_extract_bound(location, touch_row))
    return bounds


def _extract_bound(location: Location, touch: Array) -> PlaceBound:
    """Return the bound at a touch, (4,), from the location of its charges."""
    if not location.touches:
        return PlaceBound()
    place_mm = touch[: TouchColumn.ROTATION]
    distances_mm = []
    for other in location.touches:
        distances_mm.append(math.dist(other.values[: TouchColumn.ROTATION], place_mm))
    nearest = int(np.argmin(distances_mm))
    covariance = location.touches[nearest].covariance  # Of x, y and the force.
    place_deviation_mm = math.sqrt(covariance[0, 0] + covariance[1, 1])
    if distances_mm[nearest] >= place_deviation_mm:
        return PlaceBound()
    return PlaceBound(
        place_deviation_mm,
        force_deviation=math.sqrt(covariance[2, 2]) / touch[TouchColumn.FORCE],
        ambiguous=float(location.ambiguous),
    )


def _make_dataset(
    study: DesignStudy, columns: DesignColumns, attributes: Mapping[str, Any]
) -> xarray.Dataset:
    """Make the dataset of `design`.

    Parameters
    ----------
    study : DesignStudy
        The designs.
    columns : DesignColumns
        Their results.
    attributes : mapping
        Attributes of the dataset; None and empty texts are left out.
    """
    import xarray  # slow to import

    from pvdf_fem.studies.sweep_dataset import make_attributes, make_coordinates

    grid = study.grid
    dims = [axis.name for axis in grid.axes]
    coordinates = make_coordinates(grid)
    for name in PLACE_DIMS:
        about = make_attributes(f"{name[0]} of the probe", "mm")
        coordinates[name] = (name, columns.grid.coordinates_mm, about)
    kept = {key: value for key, value in attributes.items() if value not in (None, "")}
    kept |= {
        "Conventions": "CF-1.11",
        "title": "Cramér-Rao bounds of touches of a PVDF membrane",
        "source": f"pvdf_fem {__version__}",
    }
    data = xarray.Dataset(coords=coordinates, attrs=kept)
    for name, values in columns.maps.items():
        description, unit = MAPS[name]
        arranged = values.reshape(*grid.shape, *values.shape[1:])
        data[name] = ([*dims, *PLACE_DIMS], arranged, make_attributes(description, unit))
    _add_place_statistics(data)
    error_bounds = columns.response_error_bounds.reshape(grid.shape)
    about = make_attributes("error bound of the model over the charge", "1")
    data["model_error_bound"] = (dims, error_bounds, about)
    texts = np.reshape([scene.to_toml() for scene in study.scenes], grid.shape)
    data["scene"] = (dims, texts, make_attributes("the design as a scene file"))
    return data


def _add_place_statistics(data: xarray.Dataset) -> None:
    """Add medians and largest values of the deviations, and the share of ambiguous places."""
    from pvdf_fem.studies.sweep_dataset import make_attributes

    share = data.ambiguous.mean(PLACE_DIMS)
    about_share = make_attributes("share of ambiguous places", "1")
    for stem, ending in (("place_deviation", "_mm"), ("force_deviation", "")):
        name = f"{stem}{ending}"
        description, unit = MAPS[name]
        about_median = make_attributes(f"median {description}", unit)
        about_worst = make_attributes(f"largest {description}", unit)
        median = data[name].median(PLACE_DIMS)
        worst = data[name].max(PLACE_DIMS)
        data[f"{stem}_median{ending}"] = median.assign_attrs(about_median)
        data[f"{stem}_worst{ending}"] = worst.assign_attrs(about_worst)
    data["ambiguous_share"] = share.assign_attrs(about_share)


def find_best_design(data: xarray.Dataset, max_ambiguous_share: float = 0.05) -> xarray.Dataset:
    """Return the design with the least median deviation of the place.

    Parameters
    ----------
    data : xarray.Dataset
        The result of `design`.
    max_ambiguous_share : float
        Only designs with at most this share of ambiguous places are compared; where there is none,
        those with the least share.
    """
    shares = data.ambiguous_share
    medians = data.place_deviation_median_mm
    if not medians.dims:
        return data
    allowed = medians.where(shares <= max(max_ambiguous_share, float(shares.min())))
    return data.isel(allowed.argmin(...))


def make_table(data: xarray.Dataset) -> pd.DataFrame:
    """Return a table with a row for each design: its keys, and its values without places."""
    dims = data.scene.dims
    keys = [name for name, values in data.coords.items() if {*values.dims} <= {*dims}]
    values = [name for name, values in data.items() if values.dims == dims and name != "scene"]
    selected = data[values] if dims else data[values].expand_dims("design")
    return selected.to_dataframe().reset_index()[[*keys, *values]]
