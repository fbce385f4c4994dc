"""Charts of results that are no maps of one solution: frequencies, mode shapes and sweeps."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from pvdf_fem.dynamics.forced import FrequencyResponse
from pvdf_fem.dynamics.modes import Modes, Spectrum
from pvdf_fem.output.figures import COLOURS, GREY, LABEL_SIZE, draw_rim, new_figure, style

if TYPE_CHECKING:
    from xarray import DataArray, Dataset

PANEL_MM = 45.0  #: Width of the picture of a mode, or of an electrode's charges.
MARKERS = "os^Dv<>pP*"  #: A marker for each electrode, besides its colour.


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


def mode_shapes(modes: Modes, columns: int = 6) -> Figure:
    """A figure of the deflections of modes, with their frequencies in vacuum and in air."""
    spectra = {"in vacuum": modes.spectrum, "in air": modes.spectrum.in_air}
    drawn = [(where, spectrum) for where, spectrum in spectra.items() if spectrum is not None]
    panels = [(*of, i) for of in drawn for i in range(len(of[1].frequencies))]
    rows, wide = math.ceil(len(panels) / columns), min(columns, len(panels))
    with style():
        figure = new_figure(PANEL_MM * wide + 25.0, (PANEL_MM + 10.0) * rows + 8.0)
        axes = figure.subplots(rows, wide, squeeze=False, sharex=True, sharey=True)
        for ax in axes.flat[len(panels) :]:
            ax.remove()
        for ax, (where, spectrum, i) in zip(axes.flat, panels, strict=False):
            filled = _shape(ax, spectrum, i, modes.scene.film.radius_mm)
            ax.set_title(f"{i + 1}: {spectrum.frequencies[i]:.4g} Hz {where}")
            ax.label_outer()
        label = "deflection over the largest displacement"
        figure.colorbar(filled, ax=axes, label=label, shrink=0.8)
        about = "under its load" if modes.loaded else "without a load"
        figure.suptitle(f"Modes of the stretched film {about}", x=0.02, ha="left", fontsize=9)
    return figure


def _shape(ax: Axes, spectrum: Spectrum, mode: int, radius_mm: float) -> Any:
    grid, w = spectrum.equilibrium.space.basis.refinterp(spectrum.shapes[mode][:, 2], nrefs=3)
    x, y = 1e3 * grid.p
    draw_rim(ax, radius_mm, radius_mm)
    return ax.tricontourf(
        Triangulation(x, y, grid.t.T), w, levels=np.linspace(-1.0, 1.0, 21), cmap="RdBu_r"
    )


def sweep_chart(data: Dataset) -> Figure:
    """A figure of the charges of a sweep of one or two axes: curves, or a map for each electrode.

    Scenes without charges are marked, with their status. Raises ValueError for another number of
    axes, and says how to select from them.
    """
    data = data.squeeze([axis for axis, size in data.status.sizes.items() if size == 1])
    axes = list(data.status.dims)
    if len(axes) not in (1, 2):
        pick = ", ".join(f"{name}=0" for name in axes[2:])
        advice = f"choose from the others, as data.isel({pick})" if axes[2:] else "sweep some axis"
        raise ValueError(f"a chart has one or two axes, not {len(axes)}: {advice}")
    for axis in axes:
        if (along := _along(data, axis)).dtype.kind == "f":
            data = data.isel({axis: np.argsort(along.values, kind="stable")})
    with style():
        return (_curves if len(axes) == 1 else _maps)(data, *(_along(data, a) for a in axes))


def _along(data: Dataset, axis: Any) -> DataArray:
    """The coordinate of an axis that labels it: its own, or the first along it."""
    others = [c for c in data.coords.values() if c.dims == (axis,)]
    return data[axis] if axis in data.coords or not others else others[0]


def _positions(along: DataArray) -> Any:
    """Where the values of a coordinate stand on an axis: numbers at themselves, texts in a row."""
    return along.values if along.dtype.kind == "f" else np.arange(along.size)


def _label(along: DataArray) -> str:
    unit = along.attrs.get("units")
    name = along.attrs.get("long_name", str(along.name))
    return f"{name} ({unit})" if unit else name


def _scaled(along: DataArray, set_scale: Any, set_ticks: Any) -> None:
    """Scale an axis as its values are spaced, and write texts beside it."""
    if along.dtype.kind != "f":
        set_ticks(np.arange(along.size), [str(value)[:20] for value in along.values])
    elif along.size > 2 and along.values.min() > 0.0:
        steps = np.diff(np.log(along.values))
        if np.allclose(steps, steps[0], rtol=1e-3):
            set_scale("log")


def _curves(data: Dataset, along: DataArray) -> Figure:
    figure, x = new_figure(130.0, 85.0), _positions(along)
    ax = figure.subplots()
    for j, name in enumerate(data.electrode.values):
        charge = data.charge_pC.sel(electrode=name).values
        look: dict[str, Any] = {
            "color": COLOURS[j % len(COLOURS)],
            "marker": MARKERS[j % len(MARKERS)],
        }
        ax.errorbar(x, charge, data.charge_error_pC.sel(electrode=name).values, **look)
        if len(known := np.flatnonzero(np.isfinite(charge))):
            end = x[known[-1]], charge[known[-1]]
            ax.annotate(name, end, (5, 0), textcoords="offset points", va="center")
    failed = np.flatnonzero(data.status.values != "converged")
    at_foot = ax.get_xaxis_transform()
    ax.plot(x[failed], np.full(len(failed), 0.02), "x", color="black", transform=at_foot)
    for i in failed:
        status = ax.text(x[i], 0.05, str(data.status.values[i]), transform=at_foot)
        status.set(rotation=90, fontsize=LABEL_SIZE, ha="center", va="bottom")
    ax.set(xlabel=_label(along), ylabel="charge (pC)")
    _scaled(along, ax.set_xscale, ax.set_xticks)
    return figure


def _maps(data: Dataset, down: DataArray, across: DataArray) -> Figure:
    names, status = data.electrode.values, data.status.values
    columns = min(len(names), 4)
    rows = math.ceil(len(names) / columns)
    figure = new_figure(PANEL_MM * columns + 35.0, PANEL_MM * rows + 20.0)
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for ax in panels.flat[len(names) :]:
        ax.remove()
    x, y = _positions(across), _positions(down)
    charges = data.charge_pC.values
    limits = {"vmin": np.nanmin(charges), "vmax": np.nanmax(charges)}
    failed = {word: np.nonzero(status == word) for word in np.unique(status[status != "converged"])}
    for j, (ax, name) in enumerate(zip(panels.flat, names, strict=False)):
        mesh = ax.pcolormesh(x, y, charges[..., j], shading="nearest", cmap="viridis", **limits)
        for marker, (word, (rows_, columns_)) in zip("xsd^v", failed.items(), strict=False):
            look = {"color": GREY, "linestyle": "none", "markerfacecolor": "none"}
            ax.plot(x[columns_], y[rows_], marker=marker, label=word, **look)
        ax.set(title=str(name), xlabel=_label(across), ylabel=_label(down))
        ax.grid(False)
        ax.label_outer()
        _scaled(across, ax.set_xscale, ax.set_xticks)
        _scaled(down, ax.set_yscale, ax.set_yticks)
    figure.colorbar(mesh, ax=panels, label="charge (pC)")
    if failed:
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure
