"""Axes for the dimensions of a dataset: labels, scales and ticks."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axis import XAxis, YAxis
from matplotlib.ticker import MaxNLocator

from pvdf_fem.arrays import Array

if TYPE_CHECKING:
    from xarray import DataArray, Dataset

UNIT_SIGNS = {
    "um": "µm",
    "degree": "°",
}  #: Symbols of units in figures, by the names of the units in datasets.
MAX_TICKS = 5  #: Maximum number of ticks for texts and for geometrically spaced values.
MAX_TEXT = 20  #: Maximum number of characters of a text at a tick.


def find_varied_keys(data: Dataset, dimension: str) -> list[DataArray]:
    """Return the coordinates of a dataset that are scene keys varied along a dimension.

    These have an attribute ``key``. If there are none, the dimension's own coordinate is returned.
    """
    coordinates = [values for values in data.coords.values() if values.dims == (dimension,)]
    keys = [values for values in coordinates if "key" in values.attrs]
    return keys if keys else [data[dimension]]


def format_keys(keys: list[DataArray]) -> str:
    """Return a label with the names of scene keys and their units, joined by commas."""
    names = []
    for key in keys:
        name = str(key.attrs.get("long_name", key.name))
        unit = key.attrs.get("units")
        names.append(f"{name} ({UNIT_SIGNS.get(unit, unit)})" if unit else name)
    return ", ".join(names)


def format_values(key: DataArray) -> list[str]:
    """Format the values of a scene key: numbers with four digits, others as short texts.

    These are the first `MAX_TEXT` characters, without braces and quotation marks, which would come
    from tables in JSON.
    """
    if key.dtype.kind == "f":
        return [f"{value:.4g}" for value in key.values]
    return [re.sub('[{}"]', "", str(value))[:MAX_TEXT] for value in key.values]


def format_rows(keys: list[DataArray]) -> list[str]:
    """Return a text for each position along a dimension: the values of all keys there.

    Parameters
    ----------
    keys : list of DataArray
        The n values of each scene key that is varied along the dimension.

    Returns
    -------
    list of str, length n
        The values at each position, joined by commas.
    """
    columns = [format_values(key) for key in keys]
    return [", ".join(row) for row in zip(*columns, strict=True)]


def scale_axis(axis: XAxis | YAxis, keys: list[DataArray]) -> Array:
    """Set the scale and the ticks of an axis, and return the coordinates of the values on it.

    Numbers of a single key are drawn at their values: on a logarithmic scale if they are positive
    with a constant ratio, and with ticks at integers only if all are integers. Texts, and the
    values of several keys, are drawn at equal distances. At most `MAX_TICKS` of them have a tick.

    Parameters
    ----------
    axis : XAxis or YAxis
        The axis to change.
    keys : list of DataArray
        The n values of each scene key that is varied along the axis.

    Returns
    -------
    ndarray, shape (n,)
        Coordinates on the axis: the values themselves, or 0, 1, 2 and so on.
    """
    values = keys[0].values
    step = -(-values.size // MAX_TICKS)  # rounded up
    thinned = slice(None, None, step)
    if len(keys) > 1 or values.dtype.kind != "f":
        positions = np.arange(float(values.size))
        axis.set_ticks(positions[thinned], format_rows(keys)[thinned])
        if axis.axis_name == "x":
            axis.set_tick_params(labelrotation=90)
        return positions
    if _is_geometric_sequence(values):
        axis.axes.set(**{f"{axis.axis_name}scale": "log"})
        axis.set_ticks(values[thinned], [f"{value:.3g}" for value in values[thinned]])
        axis.set_ticks([], minor=True)
    elif np.array_equal(values, np.round(values)):  # no ticks between integers
        axis.set_major_locator(MaxNLocator(integer=True))
    return np.asarray(values)


def _is_geometric_sequence(values: Array) -> bool:
    """Return whether there are at least three values, all positive and with a constant ratio."""
    if values.size < 3 or values.min() <= 0.0:
        return False
    steps = np.diff(np.log(values))
    return bool(np.allclose(steps, steps[0], rtol=1e-3))
