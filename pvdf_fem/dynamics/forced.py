"""Charges of a small further force of the probe about its load, by frequency and by time.

By frequency, the equations in `oscillation` are solved directly. By time their modes answer, each
damped as losses and sound damp it at its own frequency, without the coupling and the stress's lag.
Forces are sums of switched exponentials; partial fractions give results that are exact in time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from pvdf_fem.arrays import Array
from pvdf_fem.dynamics.air import SOUND_SPEED
from pvdf_fem.dynamics.modes import air_remark
from pvdf_fem.dynamics.oscillation import ComplexArray, Oscillation, oscillations
from pvdf_fem.electrodes.channel import Channel, channels
from pvdf_fem.progress import Progress, show_progress
from pvdf_fem.scene.given import SceneLike, numbers, scene_of, taken
from pvdf_fem.scene.scene_file import SceneError, problem
from pvdf_fem.solver.adaptive import solve
from pvdf_fem.solver.solution import Solution
from pvdf_fem.summary import Summary, TabularResult, TextTable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_HZ = 1e6  #: Highest frequency, Hz.
#: Starts in s, p in 1/s and c in N of c exp(p (t - start)) from each start on.
Exponentials = tuple[tuple[float, complex, complex], ...]


def step(force_N: float, duration_s: float = math.inf) -> Exponentials:
    """A further force that comes at once, at t = 0, and stays for a time.

    Examples
    --------
    >>> pressed = transient(Scene.example("triangle"), step(force_N=0.01), [0.0, 0.01, 0.02])
    """
    force_N, duration_s = _course(force_N, duration_s)
    return (0.0, 0.0, force_N), (duration_s, 0.0, -force_N)


def half_sine(force_N: float, duration_s: float) -> Exponentials:
    """A further force F sin(pi t/T) from t = 0 to the duration T: two sines, the second cancels the
    first.

    Examples
    --------
    >>> tap = half_sine(force_N=0.01, duration_s=0.01)
    >>> transient(Scene.example("triangle"), tap, [0.0, 0.005, 0.01]).charges_pC["A"]
    """
    force_N, duration_s = _course(force_N, duration_s)
    waves, starts = ((1j, -0.5j), (-1j, 0.5j)), (0.0, duration_s)
    return tuple((t, p * np.pi / duration_s, c * force_N) for t in starts for p, c in waves)


def _course(force_N: float, duration_s: float) -> tuple[float, float]:
    """Force and duration of a touch as numbers."""
    if duration_s != math.inf:
        duration_s = taken("duration_s", duration_s, float, (1e-9, 1e9), "s")
    return taken("force_N", force_N, float, (-1e6, 1e6), "N"), duration_s


class Course(TabularResult):
    """Changes of charges and readings against a solution, by frequency or by time."""

    left_out: tuple[str, ...]

    def summary(self) -> Summary:
        """The span, the first and the last rows, and what is left out."""
        (name, along), *others = self.columns().items()
        shown = {name: along} | {key: column for key, column in others if "error" not in key}
        span = f"{name} {along.min():g} to {along.max():g}" if along.size else "none"
        notes = [f"left out: {text}" for text in self.left_out]
        table = TextTable.from_columns(shown)
        return Summary("changes by the force", [span], tables=[table], notes=notes)

    def to_json(self) -> dict[str, Any]:
        """The columns, and what is left out."""
        return {**super().to_json(), "left_out": list(self.left_out)}


@dataclass(frozen=True, eq=False, repr=False)
class FrequencyResponse(Course):
    """Complex amplitudes over the force's amplitude, (n,), by electrode, about a solution."""

    solution: Solution
    frequencies_Hz: Array
    charges_pC_N: dict[str, ComplexArray]
    charge_errors_pC_N: dict[str, Array]  #: Estimated discretisation errors, absolute.
    readings_V_N: dict[str, ComplexArray]  #: Of the channels; empty without ``[readout]``.
    resonances_Hz: Array  #: Those that the force excites, without losses, up to the last frequency.
    left_out: tuple[str, ...]  #: What the model neglects.

    def plot(self) -> Figure:
        """Draw amplitudes with the resonances marked, and phases if something damps the film."""
        from pvdf_fem.view.charts import frequency_response

        about = self.charges_pC_N, self.resonances_Hz, self.solution.scene
        return frequency_response(self.frequencies_Hz, *about)

    def columns(self) -> dict[str, Array]:
        """Columns in the table by `pvdf-fem respond`."""
        found = {"frequency_Hz": self.frequencies_Hz}
        for unit, table in (("pC_N", self.charges_pC_N), ("V_N", self.readings_V_N)):
            for name, values in table.items():
                found |= {f"{name}_real_{unit}": values.real, f"{name}_imag_{unit}": values.imag}
        return found | {f"{n}_error_pC_N": error for n, error in self.charge_errors_pC_N.items()}


@dataclass(frozen=True, eq=False, repr=False)
class Transient(Course):
    """Changes of charges and readings against a solution by time, (n,), by electrode."""

    solution: Solution
    times_s: Array
    charges_pC: dict[str, Array]
    charge_errors_pC: dict[str, Array]  #: Estimated discretisation errors, absolute.
    readings_V: dict[str, Array]  #: Of the channels; empty without ``[readout]``.
    left_out: tuple[str, ...]  #: What the model neglects.

    def columns(self) -> dict[str, Array]:
        """Times, changes of the charges with their errors, and readings."""
        found = {"time_s": self.times_s}
        for name, change in self.charges_pC.items():
            found |= {f"{name}_change_pC": change, f"{name}_error_pC": self.charge_errors_pC[name]}
        return found | {f"{name}_reading_V": V for name, V in self.readings_V.items()}


def respond(
    solution: Solution | SceneLike,
    frequencies_Hz: ArrayLike,
    refined: bool = False,
    progress: Progress | bool | None = None,
) -> FrequencyResponse:
    """Charges by a small oscillating force of the probe along z, by frequency.

    Parameters
    ----------
    solution : Solution, Scene, or what `solve` takes for a scene
        The loaded state, or a scene that is solved first, with one probe that is no tip.
    frequencies_Hz : array_like
        One or several, not below zero; `NotConvergedError` where they are too high for the film.
    refined : bool, optional
        Whether more frequencies about the resonances join.
    progress : callable or bool, optional
        As for `modes`, counted in vectors of each of two bases, of which few of the most may do.

    Examples
    --------
    >>> answer = respond(Scene.example("triangle"), [0.0, 20.0, 50.0])
    >>> abs(answer.charges_pC_N["A"])
    """
    frequencies = numbers("frequencies_Hz", frequencies_Hz, (0.0, MOST_HZ), "Hz").ravel()
    refined = taken("refined", refined, bool)
    solution, read = _loaded(solution)
    with show_progress("vectors at most", progress) as show:
        both = [oscillation.reduced(frequencies, show) for oscillation in oscillations(solution)]
    resonances = both[0].resonances(frequencies.max())
    if refined:
        frequencies = _refined(frequencies, resonances)
    charges, better = (oscillation.charges(frequencies).T for oscillation in both)
    pairs = zip(read, charges, strict=False)  # no channels without a readout
    readings = {c.name: c.harmonic(frequencies) * charge for c, charge in pairs}
    tables = _in_pC(solution, charges), _in_pC(solution, np.abs(better - charges)), readings
    return FrequencyResponse(solution, frequencies, *tables, resonances, _left_out(solution))


def _refined(frequencies: Array, resonances: Array, nearest: float = 1e-3, most: int = 12) -> Array:
    """Frequencies in Hz with more about resonances, their distances in a geometric series."""
    apart = np.geomspace(nearest, 0.1, most)
    near = np.multiply.outer(resonances, np.concatenate([1.0 - apart, 1.0 + apart])).ravel()
    inside = (near > frequencies.min()) & (near < frequencies.max())
    return np.union1d(frequencies, near[inside])


def transient(
    solution: Solution | SceneLike,
    touch: Exponentials,
    times_s: ArrayLike,
    highest_Hz: float = 1000.0,
) -> Transient:
    """Charges and readings by time, linear in a further force of the probe along z.

    Parameters
    ----------
    solution : Solution or Scene
        As of `respond`.
    touch : Exponentials
        A `half_sine` or a `step`, small beside the load.
    times_s : array_like
    highest_Hz : float, optional
        Up to which the modes are those of the film; slow touches have little beyond.

    Examples
    --------
    >>> tap = half_sine(force_N=0.01, duration_s=0.01)
    >>> answer = transient(Scene.example("triangle"), tap, [0.0, 0.005, 0.01])
    """
    if not isinstance(touch, tuple) or {np.shape(part) for part in touch} != {(3,)}:
        raise ValueError(problem("touch", touch, "is no course of a force; give half_sine(...)"))
    times = numbers("times_s", times_s, (-1e9, 1e9), "s").ravel()
    highest_Hz = taken("highest_Hz", highest_Hz, float, (1e-3, MOST_HZ), "Hz")
    solution, read = _loaded(solution)
    if not solution.fields.equilibrium.conservative:
        raise SceneError([problem("load.kind", "follower", 'has no modes; give "dead"')])
    modes, better = (_modes(o, np.linspace(0.0, highest_Hz, 24)) for o in oscillations(solution))
    charges, readings = _charges(*modes, touch, times), {}
    errors = np.abs(_charges(*better, touch, times) - charges)
    for i, channel in enumerate(read):
        discharge = [] if math.isinf(channel.resistance) else [-1.0 / channel.time_constant]
        charge = _charges(*modes, touch, times, discharge)[i]
        readings[channel.name] = channel.gain / channel.capacitance * charge
    tables = _in_pC(solution, charges), _in_pC(solution, errors), readings
    return Transient(solution, times, *tables, _left_out(solution))


def _loaded(solution: Solution | SceneLike) -> tuple[Solution, Sequence[Channel]]:
    """The solution for a scene with a force that can change, and the readout's channels."""
    scene = scene_of(solution)
    scene.require_no_tips("oscillations about the load")
    scene.require_plain_charges("oscillations", "warming_K", "temperature_K")
    if scene.single_probe is None:
        raise SceneError(["probe = (nothing): is required; add the one whose force changes"])
    solution = solution if isinstance(solution, Solution) else solve(scene)
    return solution, channels(scene) if scene.readout is not None else ()


def _in_pC(solution: Solution, charges: Any) -> dict[str, Any]:
    """Charges in C, (electrodes, n), by the names of the electrodes."""
    names = [electrode.name for electrode in solution.scene.electrode_list]
    return dict(zip(names, 1e12 * charges, strict=True))


def _left_out(solution: Solution) -> tuple[str, ...]:
    """What oscillations about a solution neglect. A disc without a baffle radiates 0.03 (k a)^2
    times the power with a baffle (rigid disc, to leading order)."""
    scene = solution.scene
    losses = "damping by the film: resonances are too high; to include it give film.loss_tangent"
    share = 0.03 * (2e3 * np.pi * scene.film.radius / SOUND_SPEED) ** 2
    sound = f"damping by sound: {100.0 * share:.1g} % of that with air.baffle = true at 1 kHz"
    remarks = {air_remark(scene): scene.air is None, losses: scene.film.loss_tangent is None}
    remarks[sound] = scene.air is not None and not scene.air.baffle
    return (*solution.left_out, *(text for text, told in remarks.items() if told))


def _modes(oscillation: Oscillation, tested: Array) -> tuple[ComplexArray, Array]:
    """Poles of modes in 1/s, (2, modes, 1), and f g in C/(kg m), (electrodes, modes), of the
    equations reduced as the charges at frequencies in Hz need it."""
    lossless = replace(oscillation, loss_tangent=0.0, radiation=0.0).reduced(tested)
    squares, shapes = scipy.linalg.eigh(lossless.stiffness, lossless.mass)
    modal, omega = lossless.projected(shapes), np.sqrt(squares)
    film = oscillation.loss_tangent * np.diag(modal.elastic) / omega
    half = 0.5 * (film + oscillation.radiation * (omega * modal.volume) ** 2)
    root = np.sqrt(half**2 - squares + 0j)
    return np.stack([root - half, -root - half])[..., None], modal.force * modal.rates.T


def _charges(
    poles: Any, weights: Array, touch: Exponentials, times: Array, discharge: Sequence[float] = ()
) -> Array:
    """Charges in C, (electrodes, times), or the remainder after a circuit with this pole in 1/s."""
    total: Any = 0.0
    for start, rate, size in touch:
        age, ends = times - start, [*poles, rate, *discharge]
        for i, z in enumerate(ends):  # partial fractions of s^zeros/prod (s - pole)
            others = math.prod((z - end for j, end in enumerate(ends) if j != i), start=1.0 + 0j)
            residue = size * z ** len(discharge) / others
            total = total + weights @ (residue * np.exp(z * np.maximum(age, 0.0)) * (age >= 0.0))
    return np.asarray(total.real)
