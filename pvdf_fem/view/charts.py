"""Charts of frequencies, mode shapes, sweeps and designs."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import XAxis, YAxis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, MaxNLocator, MultipleLocator
from matplotlib.tri import Triangulation
from skfem import Basis

from pvdf_fem.arrays import Array
from pvdf_fem.scene.scene import Scene
from pvdf_fem.view.figures import (
    HALO,
    MARKERS,
    add_colour_bar,
    choose_colours,
    draw_film,
    draw_rim,
    get_line_style,
    make_figure,
    use_style,
)

if TYPE_CHECKING:
    from xarray import DataArray, Dataset

FEW = 5  #: Values of an axis that are drawn as a curve each.
SIGNS = {"um": "µm", "degree": "°"}  #: Units as figures have them.


def draw_frequency_response(
    frequencies: Array, charges: Mapping[str, Any], resonances: Array, scene: Scene
) -> Figure:
    """A figure of all charges' complex amplitudes over the force's, with marks at resonances, and
    where something damps the film of the scene, as the title says, phases without jumps below."""
    film, sound = scene.film.loss_tangent or 0.0, bool(scene.air and scene.air.baffle)
    phases = np.degrees(np.unwrap(np.angle([*charges.values()])))
    with use_style():
        damped = bool(film or sound)
        figure = make_figure(130.0, 110.0 if damped else 80.0)
        size, *below = figure.subplots(1 + damped, sharex=True, squeeze=False)[:, 0]
        for j, (name, charge) in enumerate(charges.items()):
            look = {**get_line_style(j), "marker": ""}
            size.loglog(frequencies, np.abs(charge), label=name, **look)
            for ax in below:
                ax.semilogx(frequencies, phases[j], **look)
        figure.legend(loc="outside upper left", ncols=6, title="electrode")
        told = f"loss tangent of the film {film:g}, {'sound' if sound else 'no sound'}"
        size.set(title=f"damping: {told}" if damped else "without damping, peaks are unlimited")
        size.set(ylabel="charge over force (pC/N)")
        size.margins(x=0.0)
        _mark_resonances(size, resonances)
        for ax in below:
            _turns(ax, phases)
        size.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        size.xaxis.set_major_formatter("{x:g}")
        size.xaxis.set_minor_formatter("")
        [size, *below][-1].set_xlabel("frequency (Hz)")
    return figure


def _mark_resonances(ax: Axes, resonances: Array, room: float = 0.05) -> None:
    """Ticks above an axis of frequencies in Hz at resonances, named where a part of the axis is
    free. The axis begins at most a decade below the first resonance."""
    if not resonances.size:
        return
    low, high = ax.get_xlim()
    ax.set_xlim(max(low, 0.1 * resonances[0]), high)
    across, last = ax.get_xaxis_transform(), -np.inf
    ax.plot(
        resonances, np.ones(resonances.size), "|", color="black", transform=across, clip_on=False
    )
    for at in resonances:
        place = ax.transAxes.inverted().transform(ax.transData.transform((at, 1.0)))[0]
        if place > last + room:
            last, beside = place, {"xytext": (-2, 0), "textcoords": "offset points"}
            look: Any = {"fontsize": 7, "rotation": 90, "ha": "right", "va": "top", **beside}
            ax.annotate(f"{at:.3g} Hz", (at, 0.98), xycoords=across, path_effects=[HALO], **look)


def _turns(ax: Axes, phases: Array) -> None:
    """Scale an axis to phases in degrees, at multiples of 45 degrees."""
    low, high = 45.0 * np.floor(phases.min() / 45.0), 45.0 * np.ceil(phases.max() / 45.0)
    ax.set(ylabel="phase against the force (°)", ylim=(low - 9.0, high + 9.0))
    fewer = np.ceil(np.log2(max((high - low) / 225.0, 1.0)))
    ax.yaxis.set_major_locator(MultipleLocator(45.0 * 2.0**fewer))


def draw_mode_shapes(
    shapes: Sequence[tuple[str, Array]], basis: Basis, radius_mm: float, heading: str
) -> Figure:
    """A figure of the deflections of modes over their largest, (dofs,) on a basis, by title."""
    levels = np.linspace(-1.0, 1.0, 21)
    with use_style():
        figure, panels = _panels(len(shapes))
        for ax, (title, deflection) in zip(panels, shapes, strict=True):
            mesh, w = basis.refinterp(deflection, nrefs=3)
            draw_rim(ax, radius_mm, radius_mm)
            w = np.clip(w, -0.999, 0.999)  # a peak between nodes may be higher than the scale
            x, y = 1e3 * mesh.p
            triangles = Triangulation(x, y, mesh.t.T)
            filled = ax.tricontourf(triangles, w, levels=levels, cmap="RdBu_r")
            ax.set_title(title)
            ax.label_outer()
        for ax in panels[-2:]:  # also above an empty place
            ax.set_xlabel("x (mm)")
            ax.tick_params(labelbottom=True)
        label = "deflection over its largest"
        figure.colorbar(filled, ax=panels, label=label, shrink=0.8, aspect=10 * len(panels))
        figure.suptitle(heading, x=0.02, ha="left", fontsize=9)
    return figure


def _panels(
    count: int, abreast: int = 2, panel_mm: float = 45.0, same_y: bool = True
) -> tuple[Figure, list[Axes]]:
    """A figure with panels on equal axes, few abreast for a phone."""
    rows, columns = math.ceil(count / abreast), min(count, abreast)
    figure = make_figure(panel_mm * columns + 30.0, (panel_mm + 8.0) * rows + 10.0)
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=same_y)
    for ax in panels.flat[count:]:
        ax.remove()
    for ax in panels.flat[count - columns : count]:  # also above an empty place
        ax.tick_params(labelbottom=True)
    return figure, list(panels.flat[:count])


def draw_sweep(data: Dataset) -> Figure:
    """A figure of charges in a sweep: curves by a single axis; by two axes a map per electrode, or,
    where an axis has up to `FEW` values, a curve per value. Scenes without charges are marked, with
    their status. ValueError for more axes says how to select from them."""
    data = data.squeeze([axis for axis, size in data.status.sizes.items() if size == 1])
    axes = [str(axis) for axis in data.status.dims]
    if len(axes) not in (1, 2):
        pick = ", ".join(f"{name}=0" for name in axes[2:])
        advice = f"choose from the others, as data.isel({pick})" if axes[2:] else "sweep some axis"
        raise ValueError(f"a chart has one or two axes, not {len(axes)}: {advice}")
    for axis in axes:
        if len(varied := _varied(data, axis)) == 1 and varied[0].dtype.kind == "f":
            data = data.isel({axis: np.argsort(varied[0].values, kind="stable")})
    keys = [_varied(data, axis) for axis in sorted(axes, key=lambda axis: data.sizes[axis])]
    with use_style():
        if len(keys) == 1:
            return _curves(data, keys[0])
        draw = _families if data.sizes[keys[0][0].dims[0]] <= FEW else _maps
        return draw(data, *keys)


def _varied(data: Dataset, axis: str) -> list[DataArray]:
    """The keys that vary together along an axis."""
    beside = [values for values in data.coords.values() if values.dims == (axis,)]
    return [values for values in beside if "key" in values.attrs] or [data[axis]]


def _label(varied: list[DataArray]) -> str:
    """The keys that vary along an axis with their units."""
    names = [(v.attrs.get("long_name", v.name), v.attrs.get("units")) for v in varied]
    return ", ".join(f"{n} ({SIGNS.get(u, u)})" if u else f"{n}" for n, u in names)


def _draw_axis(axis: XAxis | YAxis, varied: list[DataArray], most_ticks: int = 5) -> Array:
    """Scale an axis as its values are spaced, and return where these stand: numbers at themselves,
    texts and several keys in a row. Few texts and logarithmic numbers do not overlap."""
    values, few = varied[0].values, slice(None, None, -(-varied[0].size // most_ticks))
    if len(varied) > 1 or values.dtype.kind != "f":
        texts = [", ".join(row) for row in zip(*map(_texts, varied), strict=True)]
        axis.set_ticks(np.arange(values.size)[few], texts[few])
        if axis.axis_name == "x":
            axis.set_tick_params(labelrotation=90)
        return np.arange(float(values.size))
    steps = np.diff(np.log(values)) if values.size > 2 and values.min() > 0.0 else np.empty(0)
    if steps.size and np.allclose(steps, steps[0], rtol=1e-3):
        axis.axes.set(**{f"{axis.axis_name}scale": "log"})
        axis.set_ticks(values[few], [f"{value:.3g}" for value in values[few]])
        axis.set_ticks([], minor=True)
    elif np.array_equal(values, np.round(values)):  # there is no electrode and a half
        axis.set_major_locator(MaxNLocator(integer=True))
    return np.asarray(values)


def _texts(keys: DataArray) -> list[str]:
    """Numbers, and the beginnings of texts (perhaps JSON tables)."""
    if keys.dtype.kind == "f":
        return [f"{value:.4g}" for value in keys.values]
    return [re.sub('[{}"]', "", str(value))[:20] for value in keys.values]


def _mark_failed(ax: Axes, x: Array, y: Array, status: Array, **look: Any) -> list[Line2D]:
    """Marks where there are no charges, labelled with their status."""
    look |= {"color": "black", "markerfacecolor": "none", "linestyle": "none"}
    marks: list[Line2D] = []
    for marker, word in zip("x" + MARKERS, sorted({*status.flat} - {"converged"}), strict=False):
        label, at = f"no charges: {word.replace('_', ' ')}", status == word
        marks += ax.plot(x[at], y[at], marker=marker, label=label, **look)
    return marks


def _curves(data: Dataset, along: list[DataArray]) -> Figure:
    figure = make_figure(130.0, 95.0)
    ax, bars = figure.subplots(), []
    x = _draw_axis(ax.xaxis, along)
    for j, name in enumerate(data.electrode.values):
        charge, error = data.charge_pC.values[:, j], data.charge_error_pC.values[:, j]
        bars.append(ax.errorbar(x, charge, error, label=str(name), **get_line_style(j)))
    look: Any = {"transform": ax.get_xaxis_transform(), "clip_on": False}
    marks = _mark_failed(ax, x, np.full(x.size, 0.02), data.status.values, **look)
    figure.legend(handles=bars, loc="outside upper left", ncols=6, title="electrode")
    figure.legend(handles=marks, loc="outside lower center")
    ax.set(xlabel=_label(along), ylabel="total charge (pC)")
    return figure


def _families(data: Dataset, by: list[DataArray], along: list[DataArray]) -> Figure:
    """A panel per electrode with curves along an axis, a curve per value on the second axis."""
    figure, panels = _panels(data.electrode.size, same_y=False)
    data = data.transpose(*by[0].dims, *along[0].dims, ...)
    names, bars, marks = [", ".join(row) for row in zip(*map(_texts, by), strict=True)], [], []
    for j, (ax, electrode) in enumerate(zip(panels, data.electrode.values, strict=True)):
        x = _draw_axis(ax.xaxis, along)
        look: Any = {"transform": ax.get_xaxis_transform(), "clip_on": False}
        charges, errors = data.charge_pC.values[..., j], data.charge_error_pC.values[..., j]
        bars = [
            ax.errorbar(x, *curve, label=name, **get_line_style(i))
            for i, (*curve, name) in enumerate(zip(charges, errors, names, strict=True))
        ]
        for status in data.status.values:
            marks += _mark_failed(ax, x, np.full(x.size, 0.02), status, **look)
        ax.set_title(f"electrode {electrode}")
    figure.legend(handles=bars, loc="outside upper left", ncols=FEW, title=_label(by))
    figure.legend(
        handles=list({m.get_label(): m for m in marks}.values()), loc="outside lower center"
    )
    figure.supxlabel(_label(along))
    figure.supylabel("total charge (pC)")
    return figure


def _maps(data: Dataset, down: list[DataArray], across: list[DataArray]) -> Figure:
    """A map per electrode with its own colours. Cells end at the first and last values."""
    figure, panels = _panels(data.electrode.size, panel_mm=56.0)
    data = data.transpose(*down[0].dims, *across[0].dims, ...)
    for ax, name, charge in zip(panels, data.electrode.values, data.charge_pC.T, strict=True):
        x, y = _draw_axis(ax.xaxis, across), _draw_axis(ax.yaxis, down)
        known = charge.values[np.isfinite(charge.values)]
        colours, low, high = choose_colours(known if known.size else [0.0, 1.0])
        look: Any = {"cmap": colours, "vmin": low, "vmax": high, "edgecolors": "face"}
        drawn = ax.pcolormesh(_edges(x), _edges(y), charge.values.T, **look)
        marks = _mark_failed(ax, *np.meshgrid(x, y), data.status.values)
        ax.set_title(f"electrode {name}")
        ax.grid(False)
        figure.colorbar(drawn, ax=ax)
    figure.supxlabel(_label(across))
    figure.supylabel(_label(down))
    figure.suptitle("total charge (pC)", x=0.02, ha="left", fontsize=9)
    figure.legend(handles=marks, loc="outside lower center")
    return figure


def _edges(values: Array) -> Array:
    """Limits (n + 1,) of cells about values (n,): halfway to the next ones, and the outer values
    themselves."""
    return np.concatenate([values[:1], 0.5 * (values[1:] + values[:-1]), values[-1:]])


def draw_designs(data: Dataset, chosen: Dataset) -> Figure:
    """A figure of designs: the median deviation of the place along the longest axis, a curve per
    value on the second axis, further axes from the chosen design; and the map of this one."""
    sizes = data.place_deviation_median_mm.sizes
    varied = sorted((axis for axis in sizes if sizes[axis] > 1), key=lambda axis: -sizes[axis])
    curves = data.sel({axis: chosen[axis].item() for axis in sizes if axis not in varied[:2]})
    with use_style():
        figure = make_figure(120.0, 190.0 if varied else 110.0)  # a phone shows both
        *above, below = figure.subplots(2 if varied else 1, squeeze=False)[:, 0]
        for ax in above:
            _draw_deviations(ax, curves.place_deviation_median_mm, [str(a) for a in varied[:2]])
        draw_design_map(below, chosen)
    return figure


def _draw_deviations(ax: Axes, medians: DataArray, axes: list[str]) -> None:
    along, *family = axes
    x = _draw_axis(ax.xaxis, [medians[along]])
    for number, value in enumerate(medians[family[0]] if family else [None]):
        curve = medians if value is None else medians.sel({family[0]: value})
        label = None if value is None else _texts(value.expand_dims("value"))[0]
        ax.plot(x, curve, label=label, **get_line_style(number))
    ax.set(xlabel=_label([medians[along]]), ylabel="median deviation of the place (mm)")
    ax.set_ylim(0.0, 1.05 * float(medians.max()))
    if family:
        ax.legend(title=_label([medians[family[0]]]))


def draw_design_map(ax: Axes, chosen: Dataset, most_mm: float | None = None) -> None:
    """Draw the map of one design on axes in mm, titled by its keys: the deviation of the place up
    to a limit, by default twice the median, its electrodes, and dots at ambiguous places."""
    median = float(chosen.place_deviation_median_mm)
    x, y, most_mm = chosen.x_mm.values, chosen.y_mm.values, most_mm or 2.0 * median
    look: Any = {"shading": "nearest", "vmin": 0.0, "vmax": most_mm, "edgecolors": "face"}
    drawn = ax.pcolormesh(x, y, chosen.place_deviation_mm, **look)
    scene = Scene.parse(str(chosen.scene.values))
    electrodes = scene.electrode_list
    ends = [
        1e3 * np.abs(electrode.outline.inscribed_polygon.bounds).max() for electrode in electrodes
    ]
    draw_film(ax, scene.film.radius_mm, electrodes, max(1.03 * x[-1], *ends))
    across, up = (places[chosen.ambiguous.values > 0.0] for places in np.meshgrid(x, y))
    ax.plot(across, up, ".", color="white", markersize=2.0)
    keys = [_told(chosen[name]) for name in chosen.coords if "key" in chosen[name].attrs]
    found = f"median {median:.3g} mm; dots: {float(chosen.ambiguous_share):.0%} ambiguous"
    ax.set_title(f"{', '.join(keys)}\n{found}".strip())
    add_colour_bar(ax, drawn, "deviation of the place (mm)", extend="max")


def _told(key: DataArray) -> str:
    """A key's value with its unit, or with its name."""
    [value], unit = _texts(key.expand_dims("one")), key.attrs.get("units")
    return f"{value} {SIGNS.get(unit, unit)}" if unit else f"{key.name} {value}"
