"""A dataset for machine learning: random touches of a sensor with charges and noisy readings.

Positions, rotations and logarithms of the force are uniformly distributed over the domain of the
response. Readings are in nominal pC, as `locate` expects them: in V times the nominal capacitance
of the channel in pF, that is before the correction of gain and offset.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.files import replace_file
from pvdf_fem.inverse.touch.locate_many import CHUNK_ROWS
from pvdf_fem.inverse.touch.measurement import Measurement
from pvdf_fem.progress import Progress
from pvdf_fem.scene.arguments import SceneLike, as_response, as_scene
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.stage import Stage
from pvdf_fem.studies.request_errors import find_noise_and_response_errors
from pvdf_fem.surrogate.charge_function import find_rotation_period_deg
from pvdf_fem.surrogate.response import Response
from pvdf_fem.surrogate.response_builder import build_response
from pvdf_fem.surrogate.touch_domain import (
    TOUCH_QUANTITIES,
    TouchColumn,
    centre_probe,
    draw_touches,
    resolve_response_settings,
)

if TYPE_CHECKING:
    import pandas as pd
    import xarray

FORMATS = (".nc", ".csv", ".parquet")  #: Extensions of the files that `write_dataset` writes.
MAX_TOUCHES = 10_000_000  #: Maximum number of touches, which takes 1.3 GB with four electrodes.
MAX_SEED = 2**63 - 1  #: Maximum seed.
#: Relative noise that determines the tolerance of the response if `sigma` is 0.
DEFAULT_SIGMA = 0.01
#: Variables over touches and electrodes, with their descriptions. Their unit is pC.
ELECTRODE_VARIABLES = {
    "charge_pC": "total charge",
    "model_error_pC": "bound on the error of the charge",
    "reading_pC": "reading with noise in V times the nominal capacitance of the channel",
}


def dataset(
    scene: SceneLike,
    touches: int = 100_000,
    seed: int = 0,
    sigma: float = 0.01,
    *,
    noise_pC: float | None = None,
    reading: str | None = None,
    response: Response | None = None,
    processes: int | None = None,
    progress: Progress | bool | None = None,
) -> xarray.Dataset:
    """Draw random touches of a sensor, with their charges and noisy readings.

    Parameters
    ----------
    scene : Scene, or anything that `solve` accepts as a scene
        Scene with the sensor and a single probe. Its table ``[model]`` defines the reach and the
        forces of the touches.
    touches : int
        Number of touches.
    seed : int
        Seed of the random numbers; the same seed reproduces the touches and the noise.
    sigma : float
        Standard deviation of a reading, relative to the total charge or to the change of the
        charge, whichever the readings measure.
    noise_pC : float, optional
        Absolute standard deviation of a reading in nominal pC, which are V times the nominal
        capacitance of the channel in pF. Default: the ``noise_V`` of the scene's ``[readout]``.
    reading : {"change", "total"}, optional
        Whether the readings are the changes of the charges due to the touch, or total charges.
        Default: the value of the scene's ``[readout]``, ``total`` without one.
    response : Response, optional
        Response of a scene whose film deforms in the same way; its domain replaces that of the
        scene's ``[model]``. Default: None, build one.
    processes : int, optional
        Number of processes that build the response. Default: None, one for each core.
    progress : callable or bool, optional
        Progress of the build, see `build_response`.

    Returns
    -------
    xarray.Dataset
        Variables over ``touch``: ``x_mm``, ``y_mm``, ``rotation_deg`` (from 0 to the probe's
        period) and ``force_N``, in the frame of the scene's stage. Variables over ``touch`` and
        ``electrode``: ``charge_pC``, ``model_error_pC`` (a bound on the error of the charge) and
        ``reading_pC``. The attribute ``scene`` is the scene as TOML.

    Raises
    ------
    SceneError, ValueError
        If arguments are wrong, before anything is solved; the message has a line for each error.
    NotConvergedError
        If the response cannot be built.

    Notes
    -----
    A reading is gain (q + n) + offset, where q is the total charge or the change of the charge and
    n is normally distributed noise with the standard deviation √((sigma q)² + (noise_pC/gain)²).

    Examples
    --------
    >>> drawn = dataset("sensor.toml", 1000, seed=1, sigma=0.005)
    >>> drawn.reading_pC.sel(electrode="A").mean()
    """
    scene = as_scene(scene)
    errors = [*find_request_errors(scene, touches, seed, sigma, noise_pC, reading)]
    if errors:
        raise ValueError("\n".join(errors))
    if response is None:
        settings = resolve_response_settings(scene, sigma if sigma else DEFAULT_SIGMA)
        response = build_response(
            centre_probe(scene),
            settings.domain.reach_mm,
            settings.domain.force_N,
            settings.tolerance,
            processes,
            progress=progress,
        )
    response = as_response(response).for_scene(scene, processes, progress=progress)
    measurement = Measurement.from_response(response, response.names, sigma, noise_pC, reading)
    drawn = draw_touches(response.domain, touches, seed)
    chunks = np.array_split(drawn, 1 + touches // CHUNK_ROWS)
    charges_pC = np.concatenate([response.evaluate(chunk)[0] for chunk in chunks])
    # The generator of the touches has the seed alone; that of the noise needs another seed.
    normal = np.random.default_rng([seed, 1]).standard_normal(charges_pC.shape)
    noisy_pC = charges_pC + measurement.compute_noise(charges_pC) * normal
    by_electrode = {
        "charge_pC": charges_pC,
        "model_error_pC": response.error_bound * np.abs(charges_pC),
        "reading_pC": measurement.to_readings(noisy_pC),
    }
    attributes = {
        "seed": seed,
        "sigma": sigma,
        "noise_pC": measurement.noise_pC.tolist(),
        "reading": measurement.reading,
        "model_error_bound": response.error_bound,
    }
    return _make_dataset(
        response, _convert_touches_to_stage(response, drawn), by_electrode, attributes
    )


def find_request_errors(
    scene: Scene,
    touches: int,
    seed: int,
    sigma: float,
    noise_pC: float | None = None,
    reading: str | None = None,
) -> Iterator[str]:
    """Yield an error message for each invalid argument of `dataset`.

    Parameters
    ----------
    scene : Scene
        Scene of the sensor, of which it must be possible to build a response.
    touches : int
        Number of touches.
    seed : int
        Seed of the random numbers.
    sigma : float
        Relative standard deviation of a reading.
    noise_pC : float, optional
        Absolute standard deviation of a reading. None: that of the readout.
    reading : {"change", "total"}, optional
        Meaning of the readings. None: that of the readout.
    """
    if not isinstance(touches, int) or not 1 <= touches <= MAX_TOUCHES:
        yield f"touches = {touches}: give a whole number from 1 to {MAX_TOUCHES}"
    if not isinstance(seed, int) or not 0 <= seed <= MAX_SEED:
        yield f"seed = {seed}: give a whole number from 0 to {MAX_SEED}"
    domain, tolerance = resolve_response_settings(scene)
    yield from find_noise_and_response_errors(scene, domain, tolerance, sigma, noise_pC, reading)


def _convert_touches_to_stage(response: Response, touches: Array) -> Array:
    """Convert touches from the frame of the film to that of the scene's stage.

    Parameters
    ----------
    response : Response
        Response whose scene has the stage and the probe. Without a stage the frames are the same.
    touches : ndarray, shape (n, 4)
        Rows of x and y in mm, rotation in degrees and force in N, in the frame of the film.

    Returns
    -------
    ndarray, shape (n, 4)
        The same in the frame of the stage; the rotations are from 0 to the probe's period.
    """
    stage = response.scene.stage or Stage()
    moved = touches.copy()
    positions = touches[:, : TouchColumn.ROTATION]
    moved[:, : TouchColumn.ROTATION], rotations = stage.to_stage(
        positions, touches[:, TouchColumn.ROTATION]
    )
    moved[:, TouchColumn.ROTATION] = rotations % find_rotation_period_deg(response)
    return moved


def _make_dataset(
    response: Response,
    touches: Array,
    by_electrode: Mapping[str, Array],
    attributes: Mapping[str, Any],
) -> xarray.Dataset:
    """Combine touches and their charges and readings to a dataset with CF attributes.

    Parameters
    ----------
    response : Response
        Response with the scene and the names of the electrodes.
    touches : ndarray, shape (n, 4)
        Rows of x and y in mm, rotation in degrees and force in N, in the frame of the scene's
        stage.
    by_electrode : mapping of str to ndarray, shape (n, electrodes)
        Values in pC of each of `ELECTRODE_VARIABLES`.
    attributes : mapping of str to values
        Further attributes of the dataset, such as the seed.
    """
    # xarray is slow to import.
    from pvdf_fem.view.files.netcdf import describe_key, make_attributes, make_dataset

    variables: dict[str, Any] = {}
    for column, name in enumerate(TOUCH_QUANTITIES):
        variables[name] = ("touch", touches[:, column], describe_key(name))
    for name, values in by_electrode.items():
        description = make_attributes(ELECTRODE_VARIABLES[name], "pC")
        variables[name] = (["touch", "electrode"], values, description)
    coordinates = {"electrode": ("electrode", [*response.names], make_attributes("electrode"))}
    title = "random touches of a PVDF membrane"
    data = make_dataset(variables, coordinates, title, {"scene": response.scene.to_toml()})
    return data.assign_attrs(attributes)


def make_table(data: xarray.Dataset) -> pd.DataFrame:
    """Convert a dataset of touches to a table with a row for each touch.

    The columns are the quantities of the touch, then one column per variable and electrode, such as
    ``charge_pC.A``. The attributes of the dataset become `attrs` of the table.
    """
    import pandas as pd  # slow to import

    columns = {name: data[name].values for name in TOUCH_QUANTITIES}
    for name in ELECTRODE_VARIABLES:
        for electrode, values in zip(data.electrode.values, data[name].values.T, strict=True):
            columns[f"{name}.{electrode}"] = values
    table = pd.DataFrame(columns)
    table.attrs = data.attrs
    return table


def write_dataset(data: xarray.Dataset, path: Path) -> None:
    """Write a dataset of touches to a file, in the format of its extension.

    Every format also stores the attributes. In Parquet they are metadata, which
    ``pandas.read_parquet(path).attrs`` returns; in CSV they are ``#`` comments before the header.

    Parameters
    ----------
    data : xarray.Dataset
        Dataset of touches from `dataset`.
    path : Path
        Path with an extension in `FORMATS`; an existing file is replaced. Parquet requires pyarrow.
    """
    from pvdf_fem.view.files.netcdf import write_netcdf

    if path.suffix.lower() == ".nc":
        write_netcdf(data, path)
        return
    table = make_table(data)
    with replace_file(path) as part:
        if path.suffix.lower() == ".parquet":
            table.to_parquet(part, engine="pyarrow", index=False)
            return
        with part.open("w", encoding="utf-8", newline="") as file:
            for name, value in table.attrs.items():
                for line in f"{name} = {value}".splitlines():
                    file.write(f"# {line}\n")
            table.to_csv(file, index=False, float_format="%.9g", lineterminator="\n")
