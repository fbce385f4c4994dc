"""Charts of vibrations: charges by frequency, and mode shapes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MultipleLocator
from matplotlib.tri import Triangulation
from skfem import Basis

from pvdf_fem.arrays import Array
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import Scene
from pvdf_fem.view.figures import (
    HALO,
    draw_rim,
    get_line_style,
    make_figure,
    make_panels,
    use_style,
)

RESONANCE_ROOM = 0.05  #: Width of a resonance's label as a fraction of the width of the axes.
PHASE_STEP_DEG = 45.0  #: Phases have ticks at multiples of this angle.
MAX_PHASE_RANGE_DEG = 225.0  #: Maximum range of phases with a tick at every multiple.


def draw_frequency_response(
    frequencies: Array, charges: Mapping[str, Any], resonances: Array, scene: Scene
) -> Figure:
    """Draw the amplitudes of the charges due to an oscillating force against its frequency.

    Resonances are marked at the top. If the loss tangent of the film or the emitted sound damps the
    vibration, the unwrapped phases are drawn below. The title describes the damping.

    Parameters
    ----------
    frequencies : ndarray, shape (n,)
        Frequencies in Hz.
    charges : mapping of str to ndarray of complex, shape (n,)
        Complex amplitude of the charge of each electrode, divided by that of the force, in pC/N.
    resonances : ndarray, shape (m,)
        Increasing frequencies in Hz of the modes that the force excites.
    scene : Scene
        The scene, whose loss tangent and air define the damping.

    Returns
    -------
    Figure
    """
    loss_tangent = scene.film.loss_tangent or 0.0
    radiates_sound = bool(scene.air and scene.air.baffle)
    is_damped = loss_tangent > 0.0 or radiates_sound
    phases = np.degrees(np.unwrap(np.angle(list(charges.values()))))
    with use_style():
        figure = make_figure(130.0, 110.0 if is_damped else 80.0)
        axes = figure.subplots(2 if is_damped else 1, sharex=True, squeeze=False)[:, 0]
        for j, (name, charge) in enumerate(charges.items()):
            look = {**get_line_style(j), "marker": ""}
            axes[0].loglog(frequencies, np.abs(charge), label=name, **look)
            if is_damped:
                axes[1].semilogx(frequencies, phases[j], **look)
        figure.legend(loc="outside upper left", ncols=6, title="electrode")
        title = "without damping, peaks are unlimited"
        if is_damped:
            sound = "sound" if radiates_sound else "no sound"
            title = f"damping: loss tangent of the film {loss_tangent:g}, {sound}"
        axes[0].set(title=title, ylabel="charge over force (pC/N)")
        axes[0].margins(x=0.0)
        _mark_resonances(axes[0], resonances)
        if is_damped:
            _scale_axis_to_phases(axes[1], phases)
        axes[0].xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes[0].xaxis.set_major_formatter("{x:g}")
        axes[0].xaxis.set_minor_formatter("")
        axes[-1].set_xlabel("frequency (Hz)")
    return figure


def _mark_resonances(ax: Axes, resonances: Array) -> None:
    """Mark resonances at the top of axes, and write the frequencies for which there is room.

    Parameters
    ----------
    ax : Axes
        Axes with frequencies in Hz. They are cut to begin at most a decade below the first
        resonance.
    resonances : ndarray, shape (m,)
        Increasing frequencies in Hz. Without any, nothing is changed.
    """
    if not resonances.size:
        return
    low, high = ax.get_xlim()
    ax.set_xlim(max(low, 0.1 * resonances[0]), high)
    above = ax.get_xaxis_transform()
    heights = np.ones(resonances.size)
    ax.plot(resonances, heights, "|", color="black", transform=above, clip_on=False)
    last_named = -np.inf
    for frequency in resonances:
        pixels = ax.transData.transform((frequency, 1.0))
        position, _ = ax.transAxes.inverted().transform(pixels)  # as a fraction of the width
        if position > last_named + RESONANCE_ROOM:
            last_named = position
            ax.annotate(
                f"{frequency:.3g} Hz",
                (frequency, 0.98),
                xycoords=above,
                xytext=(-2, 0),
                textcoords="offset points",
                fontsize=7,
                rotation=90,
                ha="right",
                va="top",
                path_effects=[HALO],
            )


def _scale_axis_to_phases(ax: Axes, phases: Array) -> None:
    """Fit the vertical axis to phases in degrees, and set its ticks.

    Ticks are at multiples of `PHASE_STEP_DEG`, or for a range above `MAX_PHASE_RANGE_DEG` at
    multiples of twice, four times, ... this angle.
    """
    low = PHASE_STEP_DEG * np.floor(phases.min() / PHASE_STEP_DEG)
    high = PHASE_STEP_DEG * np.ceil(phases.max() / PHASE_STEP_DEG)
    ax.set(ylabel="phase against the force (°)", ylim=(low - 9.0, high + 9.0))
    doublings = np.ceil(np.log2(max((high - low) / MAX_PHASE_RANGE_DEG, 1.0)))
    ax.yaxis.set_major_locator(MultipleLocator(PHASE_STEP_DEG * 2.0**doublings))


def draw_mode_shapes(
    shapes: Sequence[tuple[str, Array]], basis: Basis, rim: Outline, title: str
) -> Figure:
    """Draw a map of the deflection of each mode, divided by its largest deflection.

    Parameters
    ----------
    shapes : sequence of tuple of str and ndarray, shape (dofs,)
        Title and nodal deflections of each mode. The largest magnitude of the deflections is 1.
    basis : Basis
        The scalar finite-element basis of the deflections, on a mesh in m.
    rim : Outline
        Outline of the film in m.
    title : str
        Title of the figure.

    Returns
    -------
    Figure
    """
    levels = np.linspace(-1.0, 1.0, 21)
    with use_style():
        figure, panels = make_panels(len(shapes))
        for ax, (mode_title, deflection) in zip(panels, shapes, strict=True):
            mesh, w = basis.refinterp(deflection, nrefs=3)
            draw_rim(ax, rim)
            w = np.clip(w, -0.999, 0.999)  # a peak between nodes may exceed the scale
            x, y = 1e3 * mesh.p
            triangles = Triangulation(x, y, mesh.t.T)
            filled = ax.tricontourf(triangles, w, levels=levels, cmap="RdBu_r")
            ax.set_title(mode_title)
            ax.label_outer()
        for ax in panels[-2:]:  # also the panel above an empty position
            ax.set_xlabel("x (mm)")
            ax.tick_params(labelbottom=True)
        label = "deflection / largest deflection"
        figure.colorbar(filled, ax=panels, label=label, shrink=0.8, aspect=10 * len(panels))
        figure.suptitle(title, x=0.02, ha="left", fontsize=9)
    return figure
