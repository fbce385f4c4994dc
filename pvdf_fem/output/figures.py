"""Figures: functions that draw on a given `ax`, one style, and reproducible files.

Nothing here touches matplotlib's global state: make a `matplotlib.figure.Figure` within `style()`,
draw on its axes, and write it with `save`.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon as Patch
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import Triangulation as TriangleGrid

from pvdf_fem.dynamics.forced import FrequencyResponse
from pvdf_fem.files import replacing
from pvdf_fem.scene.scene import Electrode
from pvdf_fem.solution.solution import Solution

# The look of all figures; matplotlib's stubs ask for literal keys.
_STYLE: dict[Any, Any] = matplotlib.rc_params_from_file(
    Path(__file__).with_suffix(".mplstyle"), use_default_template=False
)
#: The colours of lines.
COLOURS: tuple[str, ...] = tuple(_STYLE["axes.prop_cycle"].by_key()["color"])
GREY = "0.45"
LABEL_SIZE = 8.0  #: Size of labels in points.

# Settings without which SVG files have random identifiers.
_REPRODUCIBLE: dict[Any, Any] = {"svg.hashsalt": "pvdf_fem", "svg.fonttype": "path"}
# Metadata that would tell a date or a version, by format.
_NO_DATE: dict[str, dict[str, None]] = {
    ".svg": {"Date": None},
    ".pdf": {"CreationDate": None},
    ".png": {"Software": None},
}


@contextmanager
def style() -> Iterator[None]:
    """A context in which new figures have the look that all figures share."""
    with matplotlib.rc_context(_STYLE):
        yield


def new_figure(width_mm: float = 160.0, height_mm: float = 100.0) -> Figure:
    """An empty figure that belongs to no window."""
    return Figure(figsize=(width_mm / 25.4, height_mm / 25.4))  # in inches


def save(figure: Figure, path: str | Path) -> None:
    """Write a figure in the format of the path's extension; the same figure gives the same bytes.
    Raises ValueError, which lists the extensions that matplotlib writes, and `FileError`."""
    path = Path(path)
    content = content_of(figure, path.suffix.lower())  # a full disk confuses some writers
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def content_of(figure: Figure, suffix: str) -> bytes:
    """The file that `save` writes for an extension with its dot."""
    with matplotlib.rc_context({**_STYLE, **_REPRODUCIBLE}):
        if layout := figure.get_layout_engine():
            layout.execute(figure)
            figure.set_layout_engine("none")  # or matplotlib lays out twice more
        content = io.BytesIO()
        figure.savefig(content, format=suffix[1:], dpi=200, metadata=_NO_DATE.get(suffix))
    return content.getvalue()


def frequency_response(response: FrequencyResponse) -> Figure:
    """A figure of all charges' amplitudes over that of the force, and their phases below."""
    with style():
        figure = new_figure()
        size, phase = figure.subplots(2, sharex=True)
        for name, charge in response.charges_pC_N.items():
            size.loglog(response.frequencies_Hz, np.abs(charge), label=name)
            phase.semilogx(response.frequencies_Hz, np.degrees(np.angle(charge)))
        size.legend(loc="upper left", ncols=len(response.charges_pC_N))
        size.set(ylabel="charge (pC/N)")
        phase.set(xlabel="frequency (Hz)", ylabel="phase (°)")
    return figure


def deflection_map(ax: Axes, solution: Solution, *, reach_mm: float | None = None) -> None:
    """Filled contours of the deflection with electrodes, probe and charges. The figure gets a
    colour bar. `reach_mm` is half the width of the shown part of the film, by default all of it.
    Raises the `NotConvergedError` of a solution without a result."""
    grid, w = solution.basis.refinterp(solution.displacement[:, 2], nrefs=2)
    low, high = (
        min(1e3 * float(w.min()), 0.0),
        max(1e3 * float(w.max()), solution.deflection_max_mm),
    )
    # about ten round levels that enclose all deflections; a flat film gets a small range
    locator = MaxNLocator(10, min_n_ticks=2)
    levels = locator.tick_values(low, high if high > low else low + 1e-9)
    x, y = 1e3 * grid.p
    filled = ax.tricontourf(TriangleGrid(x, y, grid.t.T), 1e3 * w, levels=levels, cmap="Blues")
    figure = ax.get_figure(root=True)
    assert figure is not None
    figure.colorbar(filled, ax=ax, label="deflection (mm)", fraction=0.046, pad=0.03)
    radius = solution.scene.film.radius_mm
    reach = radius if reach_mm is None else reach_mm
    angle = np.linspace(0.0, 2.0 * np.pi, 361)
    ax.plot(radius * np.cos(angle), radius * np.sin(angle), color="black", linewidth=1.0)
    for electrode in solution.scene.electrode_list:
        _draw_outline(ax, electrode.outline.shape, facecolor="white", alpha=0.55)
        _draw_outline(ax, electrode.outline.shape, edgecolor="black", linewidth=0.9)
        _name_electrode(ax, electrode, solution.charges_pC[electrode.name])
    for touch in solution.scene.loaded_probes:
        if touch.patch in solution.contacts:
            ax.plot(*solution.contacts[touch.patch].edge_mm.T, color=COLOURS[1], linewidth=1.4)
        else:
            _draw_outline(ax, touch.outline.shape, edgecolor=COLOURS[1], linewidth=1.4)
    ax.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
    ax.set(xlim=(-1.02 * reach, 1.02 * reach), ylim=(-1.02 * reach, 1.02 * reach))
    ax.grid(False)


def _draw_outline(ax: Axes, shape: shapely.Polygon, **look: Any) -> None:
    """Draw a shape in metres on axes in mm, without face and edge unless `look` has them."""
    corners = 1e3 * np.array(shape.exterior.coords)
    ax.add_patch(Patch(corners, **{"facecolor": "none", "edgecolor": "none", **look}))


def _name_electrode(ax: Axes, electrode: Electrode, charge_pC: float) -> None:
    """Name and charge beside an electrode, on the side away from the film's centre."""
    outline = electrode.outline
    centre = 1e3 * outline.centroid
    low_x, low_y, high_x, high_y = 1e3 * np.array(outline.shape.bounds)
    direction = centre / (np.linalg.norm(centre) or 1.0)
    sideways = abs(direction[0]) > 0.5
    beyond = direction[0 if sideways else 1] >= 0.0
    sign = 4.0 if beyond else -4.0
    if sideways:
        place, offset = (high_x if beyond else low_x, centre[1]), (sign, 0.0)
        align: dict[str, Any] = {"ha": "left" if beyond else "right", "va": "center"}
    else:
        place, offset = (centre[0], high_y if beyond else low_y), (0.0, sign)
        align = {"ha": "center", "va": "bottom" if beyond else "top"}
    ax.annotate(
        ("\n" if sideways else "  ").join([electrode.name, f"{charge_pC:.1f} pC"]),
        place,
        offset,
        textcoords="offset points",
        fontsize=LABEL_SIZE,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 1.0},
        clip_on=True,
        **align,
    )
