"""Axes of figures for the dimensions of a dataset: labels, scales and ticks."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axis import XAxis, YAxis
from matplotlib.ticker import MaxNLocator

from pvdf_fem.arrays import Array

if TYPE_CHECKING:
    from xarray import DataArray, Dataset

UNIT_SIGNS = {"um": "µm", "degree": "°"}  #: Units of datasets as figures show them.
MAX_TICKS = 5  #: Largest number of ticks for texts and for values of equal ratios.
MAX_TEXT = 20  #: Letters of the longest text at a tick.


def find_varied_keys(data: Dataset, dimension: str) -> list[DataArray]:
    """Return the keys of the scene that vary together along a dimension."""
    coordinates = [values for values in data.coords.values() if values.dims == (dimension,)]
    keys = [values for values in coordinates if "key" in values.attrs]
    return keys if keys else [data[dimension]]


def format_keys(keys: list[DataArray]) -> str:
    """Return the names of keys with their units."""
    names = []
    for key in keys:
        name = str(key.attrs.get("long_name", key.name))
        unit = key.attrs.get("units")
        names.append(f"{name} ({UNIT_SIGNS.get(unit, unit)})" if unit else name)
    return ", ".join(names)


def format_values(key: DataArray) -> list[str]:
    """Return the numbers of a key, or the beginnings of its texts, which may be JSON tables."""
    if key.dtype.kind == "f":
        return [f"{value:.4g}" for value in key.values]
    return [re.sub('[{}"]', "", str(value))[:MAX_TEXT] for value in key.values]


def format_rows(keys: list[DataArray]) -> list[str]:
    """Return the values of keys that vary together, joined by commas."""
    columns = [format_values(key) for key in keys]
    return [", ".join(row) for row in zip(*columns, strict=True)]


def scale_axis(axis: XAxis | YAxis, keys: list[DataArray]) -> Array:
    """Scale an axis to the values of keys that vary together.

    Parameters
    ----------
    axis : XAxis or YAxis
        The axis.
    keys : list of DataArray (n,)
        Numbers of one key are placed at their values, logarithmically where they have equal
        ratios. Texts, and values of several keys, are placed at equal distances.

    Returns
    -------
    ndarray, shape (n,)
        Places of the values on the axis.
    """
    values = keys[0].values
    thinned = slice(None, None, -(-values.size // MAX_TICKS))
    if len(keys) > 1 or values.dtype.kind != "f":
        places = np.arange(float(values.size))
        axis.set_ticks(places[thinned], format_rows(keys)[thinned])
        if axis.axis_name == "x":
            axis.set_tick_params(labelrotation=90)
        return places
    if _is_geometric(values):
        axis.axes.set(**{f"{axis.axis_name}scale": "log"})
        axis.set_ticks(values[thinned], [f"{value:.3g}" for value in values[thinned]])
        axis.set_ticks([], minor=True)
    elif np.array_equal(values, np.round(values)):  # counts have no ticks between them
        axis.set_major_locator(MaxNLocator(integer=True))
    return np.asarray(values)


def _is_geometric(values: Array) -> bool:
    """Return whether there are three or more positive values of equal ratios."""
    if values.size < 3 or values.min() <= 0.0:
        return False
    steps = np.diff(np.log(values))
    return bool(np.allclose(steps, steps[0], rtol=1e-3))
