"""How well designs of a sensor tell touches: deviations of place and force over the film.

By the Cramér-Rao bound no unbiased estimate of a touch has a smaller covariance than (JᵀΣ⁻¹J)⁻¹,
with the derivatives J of the charges and the covariance Σ of their noise. `locate` states the bound
(JᵀΣ⁻¹J)⁻¹ for its listed touches. So charges of every place, without noise, are located: the
touch found at the place has the bounds, and other touches as likely make the place ambiguous.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from pvdf_fem import __version__
from pvdf_fem.arrays import Array
from pvdf_fem.inverse.touch.locate import locate
from pvdf_fem.inverse.touch.location import Location
from pvdf_fem.inverse.touch.measurement import Measurement
from pvdf_fem.inverse.touch.validation import as_float
from pvdf_fem.progress import Progress, show_progress
from pvdf_fem.scene.arguments import SceneLike, as_response, as_scene, coerce
from pvdf_fem.scene.changes import normalize_key, parse_key
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, format_error
from pvdf_fem.studies.request_errors import find_noise_and_response_errors
from pvdf_fem.studies.scene_grid import SceneGrid
from pvdf_fem.surrogate import touch_domain
from pvdf_fem.surrogate.response import Response
from pvdf_fem.surrogate.response_builder import build_response
from pvdf_fem.surrogate.response_key import make_mechanical_key
from pvdf_fem.surrogate.touch_domain import Domain, TouchColumn

if TYPE_CHECKING:
    import pandas as pd
    import xarray

STEPS = 12  #: Steps of the lattice of places from the centre to the reach, by default.
PLACE = touch_domain.TOUCH_SCENE_KEYS[: TouchColumn.ROTATION]
OVER_PLACES = ("y_mm", "x_mm")
#: Variables over places, with meanings and units.
MAPS = {
    "place_deviation_mm": ("deviation of the place", "mm"),
    "force_deviation": ("deviation of the force over the force", "1"),
    "ambiguous": ("whether another touch is likely", "1"),
}


@dataclass(frozen=True, eq=False)
class DesignStudy:
    """Scenes of designs, and their models; ``print`` shows their numbers."""

    grid: SceneGrid
    scenes: Sequence[Scene]  #: In the order of the grid.
    #: A scene per model, and the indices of designs with equally deforming films.
    models: Sequence[tuple[Scene, Sequence[int]]]
    #: Readout keys with values by electrode, missing in designs with different electrodes.
    dropped: Sequence[str] = ()

    @classmethod
    def from_scene(cls, scene: Scene, vary: Mapping[str, Any]) -> Self:
        """Designs by keys of the scene with their values; `SceneError` with all mistakes."""
        reason = "is at every place of the reach anyhow; remove it"
        placed = [
            format_error(key, vary[key], reason) for key in vary if normalize_key(key) in PLACE
        ]
        if placed:
            raise SceneError(placed)
        scene = scene.with_(stage=None)
        ends = {key: key.rpartition(".")[2] for key in vary}
        counts = Counter([*ends.values(), *OVER_PLACES])
        axes = [
            {"name": end if counts[end] == 1 else key, key: vary[key]} for key, end in ends.items()
        ]
        scene, dropped = _for_all_electrodes(scene, axes)
        grid = _grid(scene, axes)
        scenes, alike = grid.scenes(), dict[str, list[int]]()
        try:
            own = make_mechanical_key(scene)
            for index, varied in enumerate(scenes):
                alike.setdefault(make_mechanical_key(varied), []).append(index)
        except ValueError as error:
            raise SceneError([str(error)]) from None
        # a model of the scene itself serves further purposes
        models = [(scene if text == own else scenes[i[0]], i) for text, i in alike.items()]
        return cls(grid, scenes, models, dropped)

    def __str__(self) -> str:
        count = f"{len(self.models):>8} models of the charges: one for all films that deform alike"
        of_others = "has values by electrode, the designs have other electrodes and its default"
        left_out = "".join(f"\n{key}: {of_others}" for key in self.dropped)
        return f"{len(self.scenes):>8} designs\n{count}{left_out}"

    def mistakes(
        self, domain: Domain, step_mm: float, tolerance: float, sigma: float, noise_pC: float | None
    ) -> Iterator[str]:
        """Mistakes in touches, noise, and scenes."""
        low, high = domain.force_N
        if not 0.0 < as_float(step_mm) <= domain.reach_mm:
            yield f"step_mm = {step_mm}: is not between zero and the reach, {domain.reach_mm:g} mm"
        if not sigma and not noise_pC:
            yield f"sigma = {sigma}: tells every place; give a positive one, or noise_pC"
        for scene in self.scenes:
            if not low <= (force := scene.load.force_N) <= high:
                yield f"load.force_N = {force:g}: is outside of the model's {low:g} to {high:g} N"
            yield from find_noise_and_response_errors(scene, domain, tolerance, sigma, noise_pC)


def _grid(scene: Scene, axes: Sequence[Mapping[str, Any]]) -> SceneGrid:
    return SceneGrid.from_tables(scene, axes) if axes else SceneGrid(scene, ())


def _for_all_electrodes(
    scene: Scene, axes: Sequence[Mapping[str, Any]]
) -> tuple[Scene, Sequence[str]]:
    """The scene with defaults in place of readout values by electrode, and their keys;
    unchanged where every design keeps the scene's electrode names."""
    readout = scene.readout
    fields = {} if readout is None else type(readout).model_fields
    by_name = [name for name, value in readout or () if isinstance(value, Mapping)]
    if not by_name or not any(parse_key(key)[0] == "electrodes" for axis in axes for key in axis):
        return scene, ()
    defaults = {f"readout.{name}": fields[name].default for name in by_name}
    changed = scene.with_(**defaults)
    every = (scene, *_grid(changed, axes).scenes())
    names = {tuple(electrode.name for electrode in of.electrode_list) for of in every}
    return (scene, ()) if len(names) == 1 else (changed, [*defaults])


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
    """How well designs tell a touch's place and force.

    Parameters
    ----------
    scene : Scene, or what `solve` takes for a scene
        The sensor, its probe and force. The probe's rotation counts as known.
    vary : mapping
        Keys of the scene with their values, ``{"electrodes.count": [4, 6, 8]}``; the designs are
        all combinations. Where electrode names vary, readout values by electrode have their
        defaults in every design; the attribute ``dropped`` has the keys.
    sigma, noise_pC : float
        Standard deviation of a reading: over the charge, or over its change by the touch where the
        scene's readout reads changes, and in pC besides, by default the noise of the readout.
    reach_mm, step_mm : float, optional
        Largest distance of touches from the centre, and the step of the lattice of places.
    force_range_N : tuple of float Forces of touches that may be confused.
    tolerance : float
        Error bound of new models of the charges.
    response : Response or callable, optional
        A model for designs whose films deform alike, or what gives a model of a scene. Designs with
        equally deforming films share a model; by default each model is built.
    processes, progress
        As for `build_response`.

    Returns
    -------
    xarray.Dataset
        With a dimension for each key: ``place_deviation_median_mm`` and ``_worst_mm``,
        ``force_deviation_median`` and ``_worst`` over the force, ``ambiguous_share`` of the places,
        and ``scene``, the design as TOML. With ``y_mm`` and ``x_mm`` besides, NaN beyond the reach:
        ``place_deviation_mm``, ``force_deviation``, ``ambiguous``.

    Raises
    ------
    SceneError, ValueError, NotConvergedError
        With all mistakes, before anything is solved; and for a film without a model.

    Notes
    -----
    The deviation of the place is the root mean square of the distance. Along an undetermined
    direction the deviation is the domain's extent, see `Touch.covariance`.

    Examples
    --------
    >>> vary = {"electrodes.ring_radius_mm": [8.0, 10.0]}
    >>> found = design("sensor.toml", vary, sigma=0.01, reach_mm=4.0, step_mm=2.0, tolerance=3e-2)
    >>> found.place_deviation_median_mm.to_pandas()
    """
    vary = coerce("vary", vary, dict[str, Any])
    designs = DesignStudy.from_scene(as_scene(scene), vary)
    if not callable(response) and response is not None:
        response = as_response(response)
    known = response.domain if isinstance(response, Response) else None
    reach_mm = coerce("reach_mm", reach_mm, float | None)
    force_range_N = coerce("force_range_N", force_range_N, tuple[float, float])
    tolerance = coerce("tolerance", tolerance, float)
    if reach_mm is None:
        of_each = (touch_domain.choose_default_reach_mm(first) for first, _ in designs.models)
        reach_mm = known.reach_mm if known else min(of_each)
    domain = Domain(reach_mm, known.force_N if known else force_range_N)
    step_mm = reach_mm / STEPS if step_mm is None else step_mm
    if wrong := [*designs.mistakes(domain, step_mm, tolerance, sigma, noise_pC)]:
        raise ValueError("\n".join(dict.fromkeys(wrong)))

    def model_for(first: Scene) -> Response:
        if isinstance(response, Response) and make_mechanical_key(
            response.scene
        ) == make_mechanical_key(first):
            return response
        if callable(response):
            return response(first)
        wanted = domain.reach_mm, domain.force_N, tolerance, processes
        return build_response(touch_domain.centre_probe(first), *wanted, progress=progress)

    models = [model_for(first) for first, _ in designs.models]
    steps = int(reach_mm / step_mm + 1e-9)
    x, y = np.meshgrid(*[step_mm * np.arange(-steps, steps + 1)] * 2)
    inside = np.hypot(x, y) <= reach_mm
    bounds = np.full((len(MAPS), len(designs.scenes), *inside.shape), np.nan)
    error_bounds, done = np.empty(len(designs.scenes)), 0
    with show_progress("designs", progress) as show:
        for (_, indices), films in zip(designs.models, models, strict=True):
            for index in indices:
                made = films.for_scene(designs.scenes[index], processes, check=False)
                bounds[:, index, inside] = _bounds(made, x[inside], y[inside], sigma, noise_pC)
                error_bounds[index], done = made.error_bound, done + 1
                show(done, len(designs.scenes))
    told: dict[str, Any] = {"sigma": sigma, "noise_pC": noise_pC, "reach_mm": reach_mm}
    told |= {"step_mm": step_mm, "dropped": " ".join(designs.dropped) or None}
    return _dataset(designs, x[0], bounds, error_bounds, told)


def _bounds(
    model: Response, x_mm: Array, y_mm: Array, sigma: float, noise_pC: float | None
) -> Array:
    """Values for `MAPS` at probe places (n,), (maps, n)."""
    exact, scene = replace(model, error_bound=0.0), model.scene
    touches = np.tile([*touch_domain.extract_touch(scene).values()], (len(x_mm), 1))
    touches[:, : TouchColumn.ROTATION] = np.stack([x_mm, y_mm], axis=-1)
    measured = Measurement.from_response(exact, exact.names, sigma, noise_pC, None)
    readings = measured.to_readings(exact.evaluate(touches)[0])
    rows = (dict(zip(exact.names, row, strict=True)) for row in readings)
    found = (locate(exact, row, sigma, noise_pC=noise_pC) for row in rows)
    return np.array([_bound(*pair) for pair in zip(found, touches, strict=True)]).T


def _bound(found: Location, touch: Array) -> tuple[float, ...]:
    """Values for `MAPS` at a touch (4,), from locating its charges."""
    apart_mm = [
        math.dist(other.values[: TouchColumn.ROTATION], touch[: TouchColumn.ROTATION])
        for other in found.touches
    ]
    if apart_mm:
        C = found.touches[int(np.argmin(apart_mm))].covariance
        place_mm, force = (
            math.sqrt(C[0, 0] + C[1, 1]),
            math.sqrt(C[2, 2]) / touch[TouchColumn.FORCE],
        )
        if min(apart_mm) < place_mm:
            return place_mm, force, float(found.ambiguous)
    return (math.nan,) * len(MAPS)  # no search ended at the touch


def _dataset(
    designs: DesignStudy, at_mm: Array, bounds: Array, error_bounds: Array, told: Mapping[str, Any]
) -> xarray.Dataset:
    """The dataset of `design`; `bounds` are (maps, designs, y, x)."""
    import xarray  # slow to import

    from pvdf_fem.studies.sweep_dataset import make_attributes, make_coordinates

    grid, dims = designs.grid, [axis.name for axis in designs.grid.axes]
    places = {
        name: (name, at_mm, make_attributes(f"{name[0]} of the probe", "mm"))
        for name in OVER_PLACES
    }
    told = {key: value for key, value in told.items() if value is not None}
    told |= {"Conventions": "CF-1.11", "title": "Cramér-Rao bounds of touches of a PVDF membrane"}
    told |= {"source": f"pvdf_fem {__version__}"}
    data = xarray.Dataset(coords={**make_coordinates(grid), **places}, attrs=told)
    for (name, (about, unit)), values in zip(MAPS.items(), bounds, strict=True):
        shaped = values.reshape(*grid.shape, *values.shape[1:])
        data[name] = ([*dims, *OVER_PLACES], shaped, make_attributes(about, unit))
        stem, ending = (name[:-3], "_mm") if name.endswith("_mm") else (name, "")
        if name == "ambiguous":
            share = data[name].mean(OVER_PLACES)
            data["ambiguous_share"] = share.assign_attrs(
                make_attributes("share of ambiguous places", unit)
            )
            continue
        median, worst = data[name].median(OVER_PLACES), data[name].max(OVER_PLACES)
        data[f"{stem}_median{ending}"] = median.assign_attrs(
            make_attributes(f"median {about}", unit)
        )
        data[f"{stem}_worst{ending}"] = worst.assign_attrs(
            make_attributes(f"largest {about}", unit)
        )
    error_bounds, bound = error_bounds.reshape(grid.shape), "error bound of the model"
    data["model_error_bound"] = (
        dims,
        error_bounds,
        make_attributes(f"{bound} over the charge", "1"),
    )
    texts = np.reshape([scene.to_toml() for scene in designs.scenes], grid.shape)
    data["scene"] = (dims, texts, make_attributes("the design as a scene file", ""))
    return data


def find_best_design(data: xarray.Dataset, most_ambiguous: float = 0.05) -> xarray.Dataset:
    """The design with the least median place deviation among designs with at most this share of
    ambiguous places; where none exists, with the least share."""
    shares, medians = data.ambiguous_share, data.place_deviation_median_mm
    allowed = medians.where(shares <= max(most_ambiguous, float(shares.min())))
    return data.isel(allowed.argmin(...)) if medians.dims else data


def make_table(data: xarray.Dataset) -> pd.DataFrame:
    """A row per design: its keys, and values without a map."""
    dims = data.scene.dims
    keys = [name for name, values in data.coords.items() if {*values.dims} <= {*dims}]
    plain = [name for name, values in data.items() if values.dims == dims and name != "scene"]
    rows = data[plain].expand_dims("design") if not dims else data[plain]
    return rows.to_dataframe().reset_index()[[*keys, *plain]]
