"""Charges of a film under a small oscillating force, by frequency, about its loaded state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pvdf_fem.arrays import Array
from pvdf_fem.dynamics.modes import air_remark
from pvdf_fem.dynamics.oscillation import ComplexArray, oscillations
from pvdf_fem.readout.channel import channels
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError
from pvdf_fem.solution.solution import Solution
from pvdf_fem.solution.solve import solve

MOST_HZ = 1e6  #: Highest frequency, Hz.


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Complex amplitudes over that of the probe's force, by electrode, (n,)."""

    solution: Solution  #: The loaded state.
    frequencies_Hz: Array
    charges_pC_N: dict[str, ComplexArray]
    charge_errors_pC_N: dict[str, Array]  #: Estimated discretisation errors, absolute.
    readings_V_N: dict[str, ComplexArray]  #: Of the channels; empty without ``[readout]``.
    left_out: tuple[str, ...]  #: What the model neglects.

    def columns(self) -> dict[str, Array]:
        """The columns of the table that `pvdf-fem respond` prints."""
        found = {"frequency_Hz": self.frequencies_Hz}
        for name, charge in self.charges_pC_N.items():
            found |= {f"{name}_real_pC_N": charge.real, f"{name}_imag_pC_N": charge.imag}
            found[f"{name}_error_pC_N"] = self.charge_errors_pC_N[name]
        for name, volts in self.readings_V_N.items():
            found |= {f"{name}_real_V_N": volts.real, f"{name}_imag_V_N": volts.imag}
        return found


def respond(solution: Solution | Scene, frequencies_Hz: ArrayLike) -> FrequencyResponse:
    """Charges by a small oscillating force of the probe along z, by frequency.

    Parameters
    ----------
    solution : Solution or Scene
        The loaded state, or a scene that is solved first, with one probe that is no tip.
    frequencies_Hz : array_like
        One or several, not below zero; `NotConvergedError` where they are too high for the film.
    """
    frequencies = np.atleast_1d(np.asarray(frequencies_Hz, dtype=float))
    if frequencies.ndim != 1 or not np.all((frequencies >= 0.0) & (frequencies <= MOST_HZ)):
        raise ValueError(f"frequencies_Hz: give numbers from 0 to {MOST_HZ:g} Hz")
    solution = loaded(solution)
    both, scene = oscillations(solution), solution.scene
    charges, better = (o.reduced(frequencies).charges(frequencies) for o in both)
    read = channels(scene) if scene.readout is not None else ()
    return FrequencyResponse(
        solution,
        frequencies,
        by_electrode(scene, 1e12 * charges.T),
        by_electrode(scene, 1e12 * np.abs(better - charges).T),
        {c.name: c.harmonic(frequencies) * of for c, of in zip(read, charges.T, strict=False)},
        left_out(solution),
    )


def loaded(solution: Solution | Scene) -> Solution:
    """The solution of a scene, refused where its force cannot oscillate."""
    scene = solution if isinstance(solution, Scene) else solution.scene
    scene.require_no_tips("oscillations about the load")
    if scene.single_probe is None:
        raise SceneError(["probe = (nothing): is required; add the one whose force changes"])
    return solve(scene) if isinstance(solution, Scene) else solution


def by_electrode(scene: Scene, values: Any) -> dict[str, Any]:
    """Rows of values by the names of the electrodes."""
    return dict(zip([electrode.name for electrode in scene.electrode_list], values, strict=True))


def left_out(solution: Solution) -> tuple[str, ...]:
    """What oscillations about a solution neglect."""
    scene = solution.scene
    air = () if scene.air else (air_remark(scene),)
    losses = ("damping by the film: give film.loss_tangent",)
    return (*solution.left_out, *air, *(losses if scene.film.loss_tangent is None else ()))
