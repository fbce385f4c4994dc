"""A dataset to learn from: random touches of a sensor with their charges and noisy readings.

Touches are evenly distributed over the domain of the response: by place, by rotation and by the
logarithm of the force. Readings are in nominal pC, as `locate` takes them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pvdf_fem import __version__
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

FORMATS = (".nc", ".csv", ".parquet")
MAX_TOUCHES = 10_000_000  #: They take 1.3 GB with four electrodes.
MAX_SEED = 2**63 - 1
DEFAULT_SIGMA = 0.01  #: Noise that the response is built for if readings have no relative noise.
#: Variables by touch and electrode, with their meaning. Their unit is pC.
ELECTRODE_VARIABLES = {
    "charge_pC": "total charge",
    "model_error_pC": "bound on the error of the charge",
    "reading_pC": "reading with noise, over the nominal capacitance of the channel",
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
    """Draw random touches of a sensor, with electrode charges and noisy readings.

    Parameters
    ----------
    scene : Scene, or anything that `solve` accepts as a scene
        The sensor and its probe. Its table ``[model]`` has the reach and the forces of touches.
    touches : int
        Number of touches.
    seed : int
        Seed of the random numbers; equal seeds draw equal touches and equal noise.
    sigma : float
        Standard deviation of a reading, relative to the total charge or its change, whichever is
        read.
    noise_pC : float, optional
        Absolute standard deviation of a reading in nominal pC; by default the ``noise_V`` of the
        scene's ``[readout]``.
    reading : {"change", "total"}, optional
        Whether readings are changes of the charge by the touch or total charges; by default as the
        scene's ``[readout]`` says, else ``total``.
    response : Response, optional
        Charges as a function of the touch; by default one is built.
    processes : int, optional
        Number of processes that build the response; by default one for each core.
    progress : callable or bool, optional
        Progress of the build, as for `build_response`.

    Returns
    -------
    xarray.Dataset
        By ``touch``: ``x_mm``, ``y_mm``, ``rotation_deg`` (from 0 to the probe's period) and
        ``force_N``, in the frame of the scene's stage. By ``touch`` and ``electrode``:
        ``charge_pC``, ``model_error_pC`` (a bound on the error of the charge) and ``reading_pC``.
        The attribute ``scene`` is the scene as TOML.

    Raises
    ------
    SceneError, ValueError
        If arguments are wrong, with all errors, before anything is solved.
    NotConvergedError
        If the film has no response.

    Notes
    -----
    A reading is gain (q + n) + offset, with the charge or change q and normal noise n of the
    standard deviation √((sigma q)² + (noise_pC/gain)²).

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
    # The touches use the random numbers of the seed alone, so that the noise has a second one.
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
    return _make_dataset(response, _move_to_stage(response, drawn), by_electrode, attributes)


def find_request_errors(
    scene: Scene,
    touches: int,
    seed: int,
    sigma: float,
    noise_pC: float | None = None,
    reading: str | None = None,
) -> Iterator[str]:
    """Find errors in the arguments of `dataset`, which has the same parameters.

    Parameters
    ----------
    scene : Scene
        The sensor.
    touches, seed : int
        Number of touches, and seed of the random numbers.
    sigma : float
        Relative standard deviation of a reading.
    noise_pC : float, optional
        Absolute standard deviation of a reading in pC.
    reading : {"change", "total"}, optional
        Meaning of the readings.
    """
    if not isinstance(touches, int) or not 1 <= touches <= MAX_TOUCHES:
        yield f"touches = {touches}: give a whole number from 1 to {MAX_TOUCHES}"
    if not isinstance(seed, int) or not 0 <= seed <= MAX_SEED:
        yield f"seed = {seed}: give a whole number from 0 to {MAX_SEED}"
    domain, tolerance = resolve_response_settings(scene)
    yield from find_noise_and_response_errors(scene, domain, tolerance, sigma, noise_pC, reading)


def _move_to_stage(response: Response, touches: Array) -> Array:
    """Return touches on the film, (n, 4), in the frame of the scene's stage."""
    stage = response.scene.stage or Stage()
    moved = touches.copy()
    places = touches[:, : TouchColumn.ROTATION]
    moved[:, : TouchColumn.ROTATION], rotations = stage.to_stage(
        places, touches[:, TouchColumn.ROTATION]
    )
    moved[:, TouchColumn.ROTATION] = rotations % find_rotation_period_deg(response)
    return moved


def _make_dataset(
    response: Response,
    touches: Array,
    by_electrode: Mapping[str, Array],
    attributes: Mapping[str, Any],
) -> xarray.Dataset:
    """Make the dataset.

    Parameters
    ----------
    response : Response
        Has the scene and the names of the electrodes.
    touches : array, (touches, 4)
        Touches on the stage.
    by_electrode : mapping of str to array, (touches, electrodes)
        Variables by touch and electrode.
    attributes : mapping
        Attributes of the dataset besides scene and source.
    """
    import xarray  # slow to import

    from pvdf_fem.studies.sweep_dataset import describe_key, make_attributes

    variables: dict[str, Any] = {}
    for column, name in enumerate(TOUCH_QUANTITIES):
        variables[name] = ("touch", touches[:, column], describe_key(name))
    for name, values in by_electrode.items():
        description = make_attributes(ELECTRODE_VARIABLES[name], "pC")
        variables[name] = (["touch", "electrode"], values, description)
    coordinates = {"electrode": ("electrode", [*response.names], make_attributes("electrode"))}
    return xarray.Dataset(
        variables,
        coordinates,
        {
            "Conventions": "CF-1.11",
            "title": "random touches of a PVDF membrane",
            "scene": response.scene.to_toml(),
            "source": f"pvdf_fem {__version__}",
            **attributes,
        },
    )


def make_table(data: xarray.Dataset) -> pd.DataFrame:
    """Return a table with a row for each touch.

    Its columns are the quantities of the touch, then columns like ``charge_pC.A``. The attributes
    of the dataset are `attrs` of the table.
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
    """Write a dataset to a file with an extension in `FORMATS`.

    Parquet has the attributes as metadata for ``pandas.read_parquet(path).attrs``, CSV as ``#``
    comments before its header. Parquet needs pyarrow.
    """
    from pvdf_fem.studies.sweep_dataset import write_netcdf

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
