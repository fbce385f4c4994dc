"""Vibration of the stretched film: frequencies and shapes of its lowest modes.

Small oscillations about an equilibrium with the angular frequency omega and the shape phi satisfy
K phi = omega^2 M phi, where K is the tangent stiffness at the equilibrium and M the mass matrix of
all three displacement components. Bending is part of K if ``film.bending`` is true; with ``"auto"``
it is included if it could change a frequency by more than the tolerance. The film under a rigid,
massless punch moves as a rigid body.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from skfem import Basis

from pvdf_fem.arrays import Array
from pvdf_fem.dynamics.modal_problem import ModalProblem, estimate_bending_increase
from pvdf_fem.dynamics.one_sided import require_pressed_backings
from pvdf_fem.dynamics.spectrum import AIR, VACUUM, Spectrum
from pvdf_fem.film.coupling import describe_coupling
from pvdf_fem.film.loads.load_classes import PROBE_LOADS
from pvdf_fem.mesh.gmsh_mesh import MeshError
from pvdf_fem.problem.problem import Problem
from pvdf_fem.progress import Progress, SolveCounter, show_progress
from pvdf_fem.scene.air import Air
from pvdf_fem.scene.arguments import SceneLike, as_scene, coerce
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.adaptive_loop import TooManyUnknownsError
from pvdf_fem.solver.nonlinear.status import NotConvergedError, Status
from pvdf_fem.summary import Result, Summary, TextTable, format_with_error

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_MODES = 200  #: Maximum number of modes that may be requested.
#: Rough number of linear solves per mode, for the pencils of both orders together.
SOLVES_PER_MODE = 8


@dataclass(frozen=True, eq=False, repr=False)
class Modes(Result):
    """Lowest modes of a film, or the reason why there are none.

    Unless the status is ``CONVERGED``, frequencies, shapes and `basis` raise NotConvergedError.
    """

    scene: Scene
    loaded: bool  #: Whether the film vibrates about its loaded equilibrium, not the flat state.
    status: Status  #: `Status.CONVERGED`, or why there are no modes.
    reason: str  #: Explanation of the status, and what would help.
    neglected: tuple[str, ...] = ()  #: Descriptions of the neglected effects, with their sizes.
    #: Computing times by stage: mesh, solve, modes, total.
    seconds: dict[str, float] = field(default_factory=dict)
    _spectra: Mapping[str, Spectrum] = field(default_factory=dict)

    @property
    def spectra(self) -> Mapping[str, Spectrum]:
        """Frequencies, errors and eigenvectors in `VACUUM` and, with ``[air]``, in `AIR`.

        Raises
        ------
        NotConvergedError
            If the status is not ``CONVERGED``.
        """
        if self.status is not Status.CONVERGED:
            raise NotConvergedError(f"{self.status}: {self.reason}")
        return self._spectra

    @property
    def frequencies_Hz(self) -> Array:
        """Lowest frequencies in vacuum in ascending order.

        A frequency that belongs to two modes is repeated.

        Returns
        -------
        ndarray, shape (n,)
        """
        return self.spectra[VACUUM].frequencies

    @property
    def frequency_errors_Hz(self) -> Array:
        """Estimated absolute discretisation errors of `frequencies_Hz`.

        Returns
        -------
        ndarray, shape (n,)
        """
        return self.spectra[VACUUM].errors

    @property
    def frequencies_in_air_Hz(self) -> Array | None:
        """Lowest frequencies in air in ascending order; None without ``[air]``.

        Returns
        -------
        ndarray, shape (n,), or None
        """
        return self.spectra[AIR].frequencies if AIR in self.spectra else None

    @property
    def basis(self) -> Basis:
        """Scalar finite-element basis of each component of `shapes`, on a mesh in m.

        The outlines of probes that do not affect the modes are not edges of the mesh.
        """
        return self.spectra[VACUUM].equilibrium.space.basis

    @property
    def shapes(self) -> Array:
        """Displacements u, v, w of the modes in vacuum.

        The values are those at the degrees of freedom of `basis`. Each mode is scaled so that its
        component with the largest magnitude is 1. Two modes with the same frequency are an
        arbitrary basis of their common space.

        Returns
        -------
        ndarray, shape (n, dofs, 3)
        """
        return self.spectra[VACUUM].shapes

    @property
    def _film_state(self) -> str:
        """Words for the equilibrium about which the film vibrates."""
        return "film under its load" if self.loaded else "flat film"

    def plot(self) -> Figure:
        """Plot the deflections of the modes with their frequencies.

        The modes are those in air if the scene has ``[air]``, otherwise those in vacuum.
        """
        from pvdf_fem.view.charts.vibration import draw_mode_shapes

        medium = AIR if AIR in self.spectra else VACUUM
        spectrum = self.spectra[medium]
        deflections = spectrum.shapes[:, :, 2]
        shapes = []
        for i, frequency in enumerate(spectrum.frequencies):
            shapes.append((f"{i + 1}: {frequency:.4g} Hz", deflections[i]))
        basis = spectrum.equilibrium.space.basis
        title = f"Modes of the {self._film_state} {medium}"
        return draw_mode_shapes(shapes, basis, self.scene.film.outline, title)

    def summary(self) -> Summary:
        """Summarize the modes in tables, or give the reason why there are none."""
        notes = [f"neglected: {text}" for text in self.neglected]
        if self.status is not Status.CONVERGED:
            return Summary(self.status, [self.reason], notes=notes)
        tables = [_make_table(medium, spectrum) for medium, spectrum in self.spectra.items()]
        lowest = ", ".join(f"{frequency:.4g}" for frequency in self.frequencies_Hz[:3])
        count = len(self.frequencies_Hz)
        sentence = f"{count} modes of the {self._film_state}, from {lowest} Hz on"
        return Summary(self.status, [sentence], tables=tables, notes=notes)

    def to_json(self) -> dict[str, Any]:
        """Return the dict that `pvdf-fem modes --json` prints.

        It has a reason instead of frequencies if the status is not ``CONVERGED``.
        """
        values: dict[str, Any] = {"status": str(self.status)}
        if self.status is Status.CONVERGED:
            values["unknowns"] = self.spectra[VACUUM].equilibrium.unknowns.count
            for medium, spectrum in self.spectra.items():
                unit = "in_air_Hz" if medium == AIR else "Hz"
                values[f"frequencies_{unit}"] = spectrum.frequencies.tolist()
                values[f"frequency_errors_{unit}"] = spectrum.errors.tolist()
        else:
            values["reason"] = self.reason
        values["loaded"] = self.loaded
        values["neglected"] = list(self.neglected)
        values["seconds"] = self.seconds
        return values


def _make_table(medium: str, spectrum: Spectrum) -> TextTable:
    """Make the table of the frequencies in a medium, with their errors."""
    rows = []
    for i in range(len(spectrum.frequencies)):
        frequency = float(spectrum.frequencies[i])
        value, error = format_with_error(frequency, float(spectrum.errors[i]))
        rows.append((str(i + 1), value, error))
    return TextTable((medium, "Hz", "± Hz"), tuple(rows))


def modes(
    scene: SceneLike,
    count: int = 6,
    loaded: bool = False,
    progress: Progress | bool | None = None,
) -> Modes:
    """Compute the lowest modes of vibration of a film.

    Parameters
    ----------
    scene : Scene, path of its file, dict of its tables, or a result of it
        Scene of the film. Its ``numerics.tolerance`` is the maximum relative error of a frequency.
    count : int, optional
        Number of modes, from 1 to 200.
    loaded : bool, optional
        Whether the film vibrates about its equilibrium under the load, instead of about the flat
        state. A flat membrane has modes only if it is under tension in all directions.
    progress : callable or bool, optional
        Function that is called with the numbers of finished and expected linear solves, or whether
        to show these; see `pvdf_fem.progress.show_progress`.

    Returns
    -------
    Modes
        Modes in vacuum and, with ``[air]``, in air. If they cannot be computed, `status` and
        `reason` say why; no exception is raised for that.

    Raises
    ------
    SceneError
        If the scene is not valid, has a tip and `loaded` is true, or has a one-sided backing that
        no load presses, from which the film lifts off in every oscillation.

    Examples
    --------
    >>> found = modes(Scene(air={"baffle": False}), count=3)
    >>> found.frequencies_Hz, found.frequencies_in_air_Hz
    """
    scene = as_scene(scene)
    count = coerce("count", count, int, (1, MAX_MODES))
    loaded = coerce("loaded", loaded, bool)
    if loaded:
        scene.require_no_tips("frequencies about the load")
    film_scene = scene if loaded else _keep_rigid_probes(scene)
    require_pressed_backings(film_scene)
    bending_increase = estimate_bending_increase(film_scene, count, loaded)
    bending = scene.film.bending
    if bending == "auto":
        bending = bending_increase > scene.numerics.tolerance
    problem = Problem.from_scene(film_scene.with_(**{"film.bending": bending}))
    modal = ModalProblem.with_default_budget(problem, count, loaded, bending_increase)
    pencils = 2 if scene.air else 1
    try:
        with show_progress("solves", progress) as show:
            modal.on_solve = SolveCounter(show, SOLVES_PER_MODE * count * pencils)
            level, stop = modal.solve()
    except MeshError as error:
        reason = f"{Status.MESH_FAILED.advice} ({error})"
        return Modes(scene, loaded, status=Status.MESH_FAILED, reason=reason)
    except TooManyUnknownsError as error:
        return Modes(scene, loaded, status=Status.TOLERANCE, reason=str(error))
    status = level.status
    reason = status.advice
    if status is Status.CONVERGED and level.worst > scene.numerics.tolerance:
        status = Status.TOLERANCE
        reason = f"{status.advice}, to at least {level.worst:.1e}, which was reached ({stop})"
    neglected = list(_describe_neglected_effects(scene, bending_increase, includes_bending=bending))
    if loaded:
        for is_included, text in describe_coupling(problem.scene):
            if not is_included:
                neglected.append(text)
    return Modes(
        scene,
        loaded,
        status=status,
        reason=reason,
        neglected=tuple(neglected),
        seconds=modal.timer.seconds(),
        _spectra=level.spectra,
    )


def _keep_rigid_probes(scene: Scene) -> Scene:
    """Return a copy of the scene with only its rigid probes, without their forces and heat.

    Rigid probes constrain the film even without a load; other probes have no effect on a flat film.
    """
    rigid = []
    for load in scene.loaded_probes:
        if PROBE_LOADS[load.load.kind].is_rigid:
            rigid.append(replace(load, load=load.load.unloaded))
    bare = scene.with_loaded_probes(rigid)
    return bare.with_(**dict.fromkeys(bare.warm_probes))


def _describe_neglected_effects(
    scene: Scene, bending_increase: float, includes_bending: bool
) -> tuple[str, ...]:
    """Describe the effects of bending and air, unless they are included.

    Parameters
    ----------
    scene : Scene
        Scene with the film and the air.
    bending_increase : float
        Relative increase of the highest frequency due to bending.
    includes_bending : bool
        Whether bending is included.
    """
    effects = []
    if not includes_bending:
        if bending_increase > 0.3:
            effects.append(
                'bending: the film vibrates as a plate; set film.bending = "auto" or true'
            )
        else:
            effects.append(
                "bending: raises the highest of these frequencies by about"
                f" {bending_increase:.1%}; to include it, set film.bending = true"
            )
    if not scene.air:
        effects.append(describe_missing_air(scene))
    return tuple(effects)


def describe_missing_air(scene: Scene, baffle_factor: float = 1.5) -> str:
    """Describe the added mass of air, for a scene whose air is neglected.

    Parameters
    ----------
    scene : Scene
        Scene with the film.
    baffle_factor : float, optional
        Ratio of the added mass with a baffle to that without one.

    Notes
    -----
    In the lowest mode, the added mass per area without a baffle is about the density of air times
    the film's radius.
    """
    film = scene.film
    ratio = Air().density_kg_m3 * film.radius / (film.density * film.thickness)
    sizes = f"about {baffle_factor * ratio:.2g} times the film's mass, {ratio:.2g} without a baffle"
    advice = "to include it, add [air]" if film.is_disc else "it is modelled for discs only"
    return f"air: adds {sizes}, to the lowest mode; {advice}"
