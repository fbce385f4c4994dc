"""Random touches with their charges and noisy readings: what estimators are trained and tested on.

Touches are even over the model's domain: by place, rotation and logarithm of the force. Readings
are in nominal pC, for `locate`.
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
MOST_TOUCHES = 10_000_000  #: They take 1.3 GB with four electrodes.
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
    """Random touches on a sensor, with electrode charges and noisy readings.

    Parameters
    ----------
    scene : Scene, or what `solve` takes for a scene
        The sensor and its probe. Its table ``[model]`` has the touched region and the forces.
    touches, seed : int
        How many touches are drawn, and the seed of the random numbers.
    sigma, noise_pC, reading
        Noise of readings, and what is read, as for `locate`.
    response : Response, optional
        The model of the charges; by default one is built.
    processes, progress
        As for `build_response`.

    Returns
    -------
    xarray.Dataset
        By ``touch``: ``x_mm``, ``y_mm``, ``rotation_deg`` (from 0 to the probe's period) and
        ``force_N``, in the frame of the scene's stage. By ``touch`` and ``electrode``:
        ``charge_pC``, ``model_error_pC``, a bound on the error of the charge, and ``reading_pC``.
        The attribute ``scene`` is the scene as TOML.

    Raises
    ------
    SceneError, ValueError, NotConvergedError
        With all mistakes, before anything is solved; and for a film without a model.

    Examples
    --------
    >>> drawn = dataset("sensor.toml", 1000, seed=1, sigma=0.005)
    >>> drawn.reading_pC.sel(electrode="A").mean()
    """
    scene = as_scene(scene)
    if wrong := [*find_request_errors(scene, touches, seed, sigma, noise_pC, reading)]:
        raise ValueError("\n".join(wrong))
    if response is None:
        domain, tolerance = resolve_response_settings(scene, sigma or 0.01)
        wanted = domain.reach_mm, domain.force_N, tolerance, processes
        response = build_response(centre_probe(scene), *wanted, progress=progress)
    model = as_response(response).for_scene(scene, processes, progress=progress)
    measured = Measurement.from_response(model, model.names, sigma, noise_pC, reading)
    at = draw_touches(model.domain, touches, seed)
    parts = np.array_split(at, 1 + touches // CHUNK_ROWS)
    charges = np.concatenate([model.evaluate(part)[0] for part in parts])
    # the touches use the seed's random numbers alone
    normal = np.random.default_rng([seed, 1]).standard_normal(charges.shape)
    signals = charges + measured.compute_noise(charges) * normal
    at[:, : TouchColumn.ROTATION], turned = (scene.stage or Stage()).to_stage(
        at[:, : TouchColumn.ROTATION], at[:, TouchColumn.ROTATION]
    )
    at[:, TouchColumn.ROTATION] = turned % find_rotation_period_deg(model)
    of_electrodes = charges, model.error_bound * np.abs(charges), measured.to_readings(signals)
    told = {
        "seed": seed,
        "sigma": sigma,
        "noise_pC": measured.noise_pC.tolist(),
        "reading": measured.reading,
        "model_error_bound": model.error_bound,
    }
    return _dataset(model, at, dict(zip(ELECTRODE_VARIABLES, of_electrodes, strict=True)), told)


def find_request_errors(
    scene: Scene,
    touches: int,
    seed: int,
    sigma: float,
    noise_pC: float | None = None,
    reading: str | None = None,
) -> Iterator[str]:
    """Mistakes in numbers, noise and scene."""
    limits = {"touches": (touches, 1, MOST_TOUCHES), "seed": (seed, 0, 2**63 - 1)}
    for name, (value, least, most) in limits.items():
        if not (isinstance(value, int) and least <= value <= most):
            yield f"{name} = {value}: give a whole number from {least} to {most}"
    yield from find_noise_and_response_errors(
        scene, *resolve_response_settings(scene), sigma, noise_pC, reading
    )


def _dataset(
    model: Response, at: Array, of_electrodes: Mapping[str, Array], told: Mapping[str, Any]
) -> xarray.Dataset:
    """The dataset of touches (n, 4), and arrays (n, electrodes) by their names."""
    import xarray  # slow to import

    from pvdf_fem.studies.sweep_dataset import describe_key, make_attributes

    columns = zip(TOUCH_QUANTITIES, at.T, strict=True)
    data = xarray.Dataset(
        {name: ("touch", values, describe_key(name)) for name, values in columns},
        {"electrode": ("electrode", [*model.names], {"long_name": "electrode"})},
        {
            "Conventions": "CF-1.11",
            "title": "random touches of a PVDF membrane",
            "scene": model.scene.to_toml(),
            "source": f"pvdf_fem {__version__}",
            **told,
        },
    )
    for name, values in of_electrodes.items():
        data[name] = (
            ["touch", "electrode"],
            values,
            make_attributes(ELECTRODE_VARIABLES[name], "pC"),
        )
    return data


def make_table(data: xarray.Dataset) -> pd.DataFrame:
    """A row per touch: its quantities, then columns like ``charge_pC.A``. The attributes
    of the dataset are `attrs` of the table."""
    import pandas as pd  # slow to import

    columns = {name: data[name].values for name in TOUCH_QUANTITIES}
    for name in ELECTRODE_VARIABLES:
        by_electrode = zip(data.electrode.values, data[name].values.T, strict=True)
        columns |= {f"{name}.{electrode}": values for electrode, values in by_electrode}
    rows = pd.DataFrame(columns)
    rows.attrs = data.attrs
    return rows


def write_dataset(data: xarray.Dataset, path: Path) -> None:
    """Write a dataset to a file with an extension in `FORMATS`. Parquet has the attributes as
    metadata for ``pandas.read_parquet(path).attrs``, CSV as ``#`` comments before its header.
    Parquet needs pyarrow."""
    from pvdf_fem.studies.sweep_dataset import write_netcdf

    if path.suffix.lower() == ".nc":
        write_netcdf(data, path)
        return
    rows = make_table(data)
    with replace_file(path) as part:
        if path.suffix.lower() == ".parquet":
            rows.to_parquet(part, engine="pyarrow", index=False)
            return
        with part.open("w", encoding="utf-8", newline="") as file:
            for name, value in rows.attrs.items():
                file.writelines(f"# {line}\n" for line in f"{name} = {value}".splitlines())
            rows.to_csv(file, index=False, float_format="%.9g", lineterminator="\n")
