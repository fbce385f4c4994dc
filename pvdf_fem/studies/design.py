"""Comparison of sensor designs: how well readings determine the position and force of a touch.

By the Cramér-Rao bound, no unbiased estimate of a touch has a smaller covariance than the inverse
of the Fisher information JᵀΣ⁻¹J. Here J are the derivatives of the charges with respect to position
and force, and Σ is the covariance of the noise (Kay, Fundamentals of Statistical Signal Processing,
1993, sections 3.8 and 3.9). `locate` reports this covariance for the touches that it finds.
Therefore the noise-free charges of a touch at each position of a grid are located. The touch that
is found at this position has the bound; if other touches are likely, too, the position is
ambiguous.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from pvdf_fem.progress import Progress, show_progress
from pvdf_fem.scene.arguments import SceneLike, as_response, as_scene, coerce
from pvdf_fem.scene.scene import Scene
from pvdf_fem.studies.design_study import POSITION_DIMS, DesignStudy
from pvdf_fem.studies.touch_bounds import MAPS, DesignColumns, PositionGrid
from pvdf_fem.surrogate.response import Response
from pvdf_fem.surrogate.response_builder import build_response
from pvdf_fem.surrogate.response_key import make_mechanical_key
from pvdf_fem.surrogate.touch_domain import (
    Domain,
    centre_probe,
    choose_default_reach_mm,
)

if TYPE_CHECKING:
    import pandas as pd
    import xarray

#: Default number of grid steps from the centre to the reach.
DEFAULT_STEPS = 12


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
    """Compare sensor designs by how well their readings determine position and force of a touch.

    Parameters
    ----------
    scene : Scene, or anything that `solve` accepts as a scene
        Base design, with the probe and the force of the touches. The rotation of the probe is
        assumed to be known.
    vary : mapping of str to sequence
        Keys of the scene with their values, ``{"electrodes.count": [4, 6, 8]}``. The designs are
        all combinations. If the names of the electrodes vary, readout values by electrode are
        replaced by their defaults in every design; the attribute ``dropped`` lists these keys.
    sigma : float
        Standard deviation of a reading, relative to the total charge or to the change of the
        charge, whichever the scene's readout measures.
    noise_pC : float, optional
        Absolute standard deviation of a reading in pC. Default: the noise of the readout.
    reach_mm : float, optional
        Maximum distance of a touch from the centre. Default: that of the response, or the smallest
        default of all designs.
    step_mm : float, optional
        Distance between neighbouring positions. Default: a twelfth of the reach.
    force_range_N : tuple of float
        Minimum and maximum force of the touches with which a touch may be confused.
    tolerance : float
        Maximum error bound of the responses that are built.
    response : Response or callable, optional
        Response for those designs whose films deform in the same way as its own, or a function that
        returns the response of a scene. Default: responses are built, one for all designs whose
        films deform in the same way.
    processes : int, optional
        Number of processes that build responses. Default: None, one for each core.
    progress : callable or bool, optional
        Function that is called with the numbers of finished and of all designs, or whether to show
        these; see `pvdf_fem.progress.show_progress`.

    Returns
    -------
    xarray.Dataset
        Dataset with a dimension for each key. Over the designs: ``place_deviation_median_mm`` and
        ``place_deviation_worst_mm``; ``force_deviation_median`` and ``force_deviation_worst``,
        relative to the force; ``ambiguous_share``, the fraction of ambiguous positions;
        ``model_error_bound``; and ``scene``, the design as TOML. Also over ``y_mm`` and ``x_mm``,
        NaN outside of the reach: ``place_deviation_mm``, ``force_deviation`` and ``ambiguous``.

    Raises
    ------
    SceneError, ValueError
        If arguments are wrong, before anything is solved; the message has a line for each error.
    NotConvergedError
        If the response of a film cannot be built.

    Notes
    -----
    With the covariance C = (JᵀΣ⁻¹J)⁻¹ of x, y and the force F, the standard deviation of the
    position is √(Cxx + Cyy), the root mean square of the distance, and that of the force is
    √C_FF/F. In a direction that the readings do not determine, the deviation is the extent of the
    domain, see `Touch.covariance`.

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
    columns = DesignColumns(len(study.scenes), PositionGrid(reach_mm, step_mm))
    finished = 0
    with show_progress("designs", progress) as show:
        for group, shared_response in zip(study.groups, responses, strict=True):
            for index in group.indices:
                design_response = shared_response.for_scene(
                    study.scenes[index], processes, check=False
                )
                columns.assess_design(index, design_response, sigma, noise_pC)
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
    """Return the caller's response of a scene, or build one if there is none that can be used.

    Parameters
    ----------
    scene : Scene
        Scene whose response is needed.
    response : Response or callable, optional
        Response to return if its film deforms in the same way as that of the scene, or a function
        that is called with the scene and whose result is returned. None: build a response.
    domain : Domain
        Reach and forces of a new response.
    tolerance : float
        Maximum error bound of a new response.
    processes : int, optional
        Number of processes of a build, see `build_response`.
    progress : callable or bool, optional
        Progress of a build, see `build_response`.
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


def _make_dataset(
    study: DesignStudy, columns: DesignColumns, attributes: Mapping[str, Any]
) -> xarray.Dataset:
    """Arrange the results of designs over the keys that vary, with statistics over the positions.

    Parameters
    ----------
    study : DesignStudy
        Designs with the keys that vary, which become the dimensions.
    columns : DesignColumns
        Results of the designs in the order of `study.scenes`.
    attributes : mapping of str to values
        Additional attributes of the dataset. Those that are None or an empty text are left out.
    """
    # xarray is slow to import.
    from pvdf_fem.studies.sweep_dataset import make_coordinates
    from pvdf_fem.view.files.netcdf import make_attributes, make_dataset

    grid = study.grid
    dims = [axis.name for axis in grid.axes]
    coordinates = make_coordinates(grid)
    for name in POSITION_DIMS:
        about = make_attributes(f"{name[0]} of the probe", "mm")
        coordinates[name] = (name, columns.grid.coordinates_mm, about)
    kept = {key: value for key, value in attributes.items() if value not in (None, "")}
    title = "Cramér-Rao bounds of touches of a PVDF membrane"
    data = make_dataset({}, coordinates, title, kept)
    for name, values in columns.maps.items():
        description, unit = MAPS[name]
        arranged = values.reshape(*grid.shape, *values.shape[1:])
        data[name] = ([*dims, *POSITION_DIMS], arranged, make_attributes(description, unit))
    _add_position_statistics(data)
    error_bounds = columns.response_error_bounds.reshape(grid.shape)
    about = make_attributes("error bound of the response, relative to the charge", "1")
    data["model_error_bound"] = (dims, error_bounds, about)
    texts = np.reshape([scene.to_toml() for scene in study.scenes], grid.shape)
    data["scene"] = (dims, texts, make_attributes("the design as a scene file"))
    return data


def _add_position_statistics(data: xarray.Dataset) -> None:
    """Add variables with statistics over the positions to a dataset of designs, in place.

    These are the medians and the largest values of the standard deviations of position and force,
    and the fraction of ambiguous positions. Positions without a result are left out of them.
    """
    from pvdf_fem.view.files.netcdf import make_attributes

    fraction = data.ambiguous.mean(POSITION_DIMS)
    about_fraction = make_attributes("fraction of ambiguous positions", "1")
    for stem, ending in (("place_deviation", "_mm"), ("force_deviation", "")):
        name = f"{stem}{ending}"
        description, unit = MAPS[name]
        about_median = make_attributes(f"median {description}", unit)
        about_worst = make_attributes(f"largest {description}", unit)
        median = data[name].median(POSITION_DIMS)
        worst = data[name].max(POSITION_DIMS)
        data[f"{stem}_median{ending}"] = median.assign_attrs(about_median)
        data[f"{stem}_worst{ending}"] = worst.assign_attrs(about_worst)
    data["ambiguous_share"] = fraction.assign_attrs(about_fraction)


def find_best_design(data: xarray.Dataset, max_ambiguous: float = 0.05) -> xarray.Dataset:
    """Find the design with the smallest median standard deviation of the position.

    Parameters
    ----------
    data : xarray.Dataset
        Result of `design`.
    max_ambiguous : float
        Maximum fraction of ambiguous positions. If every design has a larger fraction, only the
        designs with the smallest fraction are compared.

    Returns
    -------
    xarray.Dataset
        Values of the best design, without the dimensions of the designs. A result with a single
        design and no such dimensions is returned as it is.
    """
    fractions = data.ambiguous_share
    medians = data.place_deviation_median_mm
    if not medians.dims:
        return data
    allowed = medians.where(fractions <= max(max_ambiguous, float(fractions.min())))
    return data.isel(allowed.argmin(...))


def make_table(data: xarray.Dataset) -> pd.DataFrame:
    """Make a table of a result of `design`, with a row for each design.

    The columns are the keys that vary, and all variables that have a single value per design except
    the scene.
    """
    dims = data.scene.dims
    keys = [name for name, values in data.coords.items() if set(dims).issuperset(values.dims)]
    values = [name for name, values in data.items() if values.dims == dims and name != "scene"]
    selected = data[values] if dims else data[values].expand_dims("design")
    return selected.to_dataframe().reset_index()[[*keys, *values]]
