"""Charts of results that are no maps of one solution: frequencies, mode shapes and sweeps."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from pvdf_fem.arrays import Array
from pvdf_fem.dynamics.forced import FrequencyResponse
from pvdf_fem.dynamics.modes import Modes, Spectrum
from pvdf_fem.output.figures import MARKERS, draw_rim, new_figure, style

if TYPE_CHECKING:
    from xarray import DataArray, Dataset

PANEL_MM = 45.0  #: Width of the picture of a mode, or of an electrode's charges.


def frequency_response(response: FrequencyResponse) -> Figure:
    """A figure of all charges' amplitudes over that of the force, and their phases below."""
    with style():
        figure = new_figure()
        size, phase = figure.subplots(2, sharex=True)
        for name, charge in response.charges_pC_N.items():
            size.loglog(response.frequencies_Hz, np.abs(charge), label=name)
            phase.semilogx(response.frequencies_Hz, np.degrees(np.angle(charge)))
        size.legend(loc="upper left", ncols=len(response.charges_pC_N), title="electrode")
        size.set(ylabel="charge over force (pC/N)")
        phase.set(xlabel="frequency (Hz)", ylabel="phase against the force (°)")
    return figure


def mode_shapes(modes: Modes) -> Figure:
    """A figure of the deflections of modes, with their frequencies in vacuum and in air."""
    spectra = {"in vacuum": modes.spectrum, "in air": modes.spectrum.in_air}
    shapes = [
        (f"{i + 1}: {f:.4g} Hz {where}", spectrum, i)
        for where, spectrum in spectra.items()
        if spectrum is not None
        for i, f in enumerate(spectrum.frequencies)
    ]
    about = "under its load" if modes.loaded else "without a load"
    with style():
        figure, panels = _panels(len(shapes), 6)
        for ax, (title, spectrum, i) in zip(panels, shapes, strict=True):
            filled = _shape(ax, spectrum, i, modes.scene.film.radius_mm)
            ax.set_title(title)
            ax.label_outer()
        label = "deflection over its largest"
        figure.colorbar(filled, ax=panels, label=label, shrink=0.8)
        figure.suptitle(f"Modes of the stretched film {about}", x=0.02, ha="left", fontsize=9)
    return figure


def _shape(ax: Axes, spectrum: Spectrum, mode: int, radius_mm: float) -> Any:
    grid, w = spectrum.equilibrium.space.basis.refinterp(spectrum.shapes[mode][:, 2], nrefs=3)
    x, y = 1e3 * grid.p
    draw_rim(ax, radius_mm, radius_mm)
    levels, triangles = np.linspace(-1.0, 1.0, 21), Triangulation(x, y, grid.t.T)
    w = np.clip(w, -0.999, 0.999)  # a peak between nodes may be higher than the scale
    return ax.tricontourf(triangles, w, levels=levels, cmap="RdBu_r")


def _panels(count: int, most: int) -> tuple[Figure, list[Axes]]:
    """A figure with panels of the same axes, at most `most` beside each other."""
    rows, columns = math.ceil(count / most), min(count, most)
    figure = new_figure(PANEL_MM * columns + 30.0, (PANEL_MM + 8.0) * rows + 10.0)
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for ax in panels.flat[count:]:
        ax.remove()
    return figure, list(panels.flat[:count])


def sweep_chart(data: Dataset) -> Figure:
    """A figure of the charges of a sweep of one or two axes: curves, or a map for each electrode.
    Scenes without charges are marked, with their status. Raises ValueError for another number of
    axes, and says how to select from them."""
    data = data.squeeze([axis for axis, size in data.status.sizes.items() if size == 1])
    axes = [str(axis) for axis in data.status.dims]
    if len(axes) not in (1, 2):
        pick = ", ".join(f"{name}=0" for name in axes[2:])
        advice = f"choose from the others, as data.isel({pick})" if axes[2:] else "sweep some axis"
        raise ValueError(f"a chart has one or two axes, not {len(axes)}: {advice}")
    for along in (_along(data, axis) for axis in axes):
        if along.dtype.kind == "f":
            data = data.isel({along.dims[0]: np.argsort(along.values, kind="stable")})
    with style():
        return (_curves if len(axes) == 1 else _maps)(data, *(_along(data, a) for a in axes))


def _along(data: Dataset, axis: str) -> DataArray:
    """The coordinate that labels an axis: its own, or the first along it."""
    others = [values for values in data.coords.values() if values.dims == (axis,)]
    return data[axis] if axis in data.coords or not others else others[0]


def _places(along: DataArray) -> Array:
    """Where values stand on an axis: numbers at themselves, texts in a row."""
    return along.values if along.dtype.kind == "f" else np.arange(float(along.size))


def _label(axis: Axis, along: DataArray, set_scale: Callable[[str], None]) -> None:
    """Name an axis with its unit, and scale it as its values are spaced."""
    name, unit = along.attrs.get("long_name", along.name), along.attrs.get("units")
    axis.set_label_text(f"{name} ({unit})" if unit else str(name))
    if along.dtype.kind != "f":
        axis.set_ticks(np.arange(along.size), [str(value)[:20] for value in along.values])
    elif along.size > 2 and along.values.min() > 0.0:
        steps = np.diff(np.log(along.values))
        if np.allclose(steps, steps[0], rtol=1e-3):
            set_scale("log")
            axis.set_ticks(along.values, [f"{value:g}" for value in along.values])
            axis.set_ticks([], minor=True)


def _curves(data: Dataset, along: DataArray) -> Figure:
    figure, x = new_figure(130.0, 85.0), _places(along)
    ax = figure.subplots()
    for j, name in enumerate(data.electrode.values):
        charge, error = data.charge_pC.values[:, j], data.charge_error_pC.values[:, j]
        ax.errorbar(x, charge, error, marker=MARKERS[j % len(MARKERS)], label=str(name))
    status, foot = data.status.values, ax.get_xaxis_transform()
    failed = np.flatnonzero(status != "converged")
    ax.plot(x[failed], np.full(failed.size, 0.03), "x", color="black", transform=foot)
    for i in failed:
        words = ax.text(x[i], 0.06, status[i], rotation=90, transform=foot, clip_on=True)
        words.set(ha="center", va="bottom")
    ax.legend(title="electrode")
    ax.set_ylabel("total charge (pC)")
    _label(ax.xaxis, along, ax.set_xscale)
    return figure


def _maps(data: Dataset, down: DataArray, across: DataArray) -> Figure:
    charges, status = data.charge_pC.values, data.status.values
    figure, panels = _panels(data.electrode.size, 4)
    x, y, known = _places(across), _places(down), charges[np.isfinite(charges)]
    norm = Normalize(min(known, default=0.0), max(known, default=1.0))
    for ax, name, j in zip(panels, data.electrode.values, range(len(panels)), strict=True):
        drawn = ax.pcolormesh(x, y, charges[..., j], shading="nearest", norm=norm)
        for marker, word in zip("xsd^v", sorted({*status.flat} - {"converged"}), strict=False):
            row, column = np.nonzero(status == word)
            ax.plot(x[column], y[row], marker, color="black", markerfacecolor="none", label=word)
        ax.set_title(str(name))
        ax.grid(False)
        _label(ax.xaxis, across, ax.set_xscale)
        _label(ax.yaxis, down, ax.set_yscale)
        ax.label_outer()
    figure.colorbar(drawn, ax=panels, label="total charge (pC)")
    handles, labels = panels[0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure
