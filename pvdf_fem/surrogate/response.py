"""The charges of a sensor as a function of position, rotation and force of a probe.

A response is a spline that `build_response` makes from a few dozen solves. Its error is measured by
comparison with full solves of random touches. It keeps the stress about the probe, from which the
spline for other electrodes, d31 and d32 can be made without new solves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.progress import Progress, TaskRunner, show_progress
from pvdf_fem.scene.arguments import coerce, coerce_array
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.summary import Result, Summary
from pvdf_fem.surrogate.charge_function import UnloadedCharges, compute_unloaded_charges_pC
from pvdf_fem.surrogate.charge_sensitivity import (
    ChargeSensitivities,
    fit_sensitivities,
    list_film_keys,
)
from pvdf_fem.surrogate.charge_spline import evaluate_force_powers, tabulate_charges
from pvdf_fem.surrogate.response_file import FileScene, read_response, write_response
from pvdf_fem.surrogate.response_key import (
    gives_same_charges,
    has_equal_electrodes,
    require_same_mechanics,
)
from pvdf_fem.surrogate.stress.stress_modes import StressModes
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, Domain, TouchColumn, require_within
from pvdf_fem.surrogate.uniform_spline import UniformSpline
from pvdf_fem.surrogate.validation_solves import ValidationSolves, make_solve_tasks

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# `Response.evaluate` multiplies (value, d/dx, d/dy, d/drotation) of the spline by (value, d/dforce)
# of the powers of the force. These five of the eight products are the value and its derivatives
# with respect to x, y, rotation and force; the others are second derivatives.
_VALUE_AND_SLOPES: Indices = np.array([0, 2, 4, 6, 1])


@dataclass(frozen=True, eq=False, repr=False)
class Response(Result):
    """Charges of the electrodes as a fast function of the touch.

    Examples
    --------
    >>> response = build_response("sensor.toml", tolerance=3e-2)
    >>> response.save("sensor.response")
    >>> charges_pC, derivatives = response.evaluate([[2.0, 1.0, 0.0, 0.5]])  # x, y, rotation, force
    """

    #: Names of the quantities in a row of touches.
    quantity_names: ClassVar[tuple[str, ...]] = TOUCH_QUANTITIES
    #: Whether thousands of evaluations take less than a second.
    is_fast: ClassVar[bool] = True
    #: Scene of the film, the electrodes and the probe. The charges do not depend on its probe
    #: position and force, which are defaults of `locate`.
    scene: FileScene
    #: Touches for which the response is valid.
    domain: Domain
    #: Bound on the error of a charge, as a fraction of |d31 X| + |d32 Y| with the stress integrals
    #: X, Y of the electrode; see `with_measured_error`.
    error_bound: float
    #: Spline over x in mm, y in mm and rotation in degrees. Its functions are the coefficients in
    #: pC of powers of the scaled force, ordered by power, then by electrode.
    spline: UniformSpline
    #: Requested maximum of the error bound.
    tolerance: float = 1e-3
    #: Notes on the build; if the bound exceeds the tolerance, what would help.
    notes: tuple[str, ...] = ()
    #: Stress about the probe, from which `for_scene` makes other responses.
    stress_modes: StressModes | None = None
    #: Full solves with which the error was measured.
    validation: ValidationSolves | None = None
    #: Charges of the unloaded film and their errors in pC; None if they are not finite, without an
    #: unloaded equilibrium, or not computed.
    unloaded_charges_pC: UnloadedCharges | None = None
    #: Derivatives of the charges with respect to uncertain parameters of the film.
    sensitivities: ChargeSensitivities | None = None

    def summary(self) -> Summary:
        """Return a summary with the electrodes, the domain, the error bound and the notes."""
        about = f"charges of {', '.join(self.names)} for {self.domain}"
        lines = [f"errors: up to {self.error_bound:.2g} of a charge", *self.notes]
        return Summary(self.status, [about], notes=lines)

    def to_json(self) -> dict[str, Any]:
        """Return what ``pvdf-fem model --json`` prints, except the name of the file."""
        return {
            "electrodes": list(self.names),
            "reach_mm": self.domain.reach_mm,
            "force_range_N": list(self.domain.force_N),
            "error_bound": self.error_bound,
            "remarks": list(self.notes),
        }

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the electrodes."""
        return tuple(electrode.name for electrode in self.scene.electrode_list)

    @property
    def status(self) -> Status:
        """Status ``CONVERGED`` if the error bound is within the tolerance, else ``TOLERANCE``."""
        return Status.CONVERGED if self.error_bound <= self.tolerance else Status.TOLERANCE

    def evaluate(self, touches: ArrayLike) -> tuple[Array, Array]:
        """Evaluate the total charges of touches and their derivatives.

        Parameters
        ----------
        touches : array_like, shape (n, 4)
            Rows of x and y in mm, rotation in degrees and force in N. A single row may have the
            shape (4,).

        Returns
        -------
        charges : ndarray, shape (n, electrodes)
            Charges in pC.
        derivatives : ndarray, shape (n, electrodes, 4)
            Derivatives with respect to x, y, rotation and force, in pC per mm, degree and N.

        Raises
        ------
        ValueError
            If a touch is outside of the domain or not finite.
        """
        touches = coerce_array("touches", touches).reshape(-1, len(TOUCH_QUANTITIES))
        require_within(self.domain, touches)
        count = len(touches)
        # shape (n, value and 3 derivatives, powers, electrodes)
        coefficients = self.spline.evaluate_with_gradient(touches[:, : TouchColumn.FORCE])
        coefficients = coefficients.reshape(count, 4, -1, len(self.names))
        forces_N = touches[:, TouchColumn.FORCE]
        # shape (n, value and derivative, powers)
        powers = evaluate_force_powers(self.domain, forces_N, coefficients.shape[2])
        products = np.matmul(powers[:, None], coefficients).reshape(count, 8, -1)
        charges_and_slopes = products.take(_VALUE_AND_SLOPES, axis=1)
        return charges_and_slopes[:, 0], charges_and_slopes[:, 1:].swapaxes(1, 2)

    def for_scene(
        self,
        scene: Scene,
        processes: int | None = None,
        *,
        check: bool = True,
        progress: Progress | bool | None = None,
    ) -> Response:
        """Make the response of another scene whose film deforms in the same way.

        The scene may have other electrodes, d31, d32, readout and stage. It may also have another
        position of the probe and another force, which have no effect on a response.

        Parameters
        ----------
        scene : Scene
            Other scene.
        processes : int, optional
            Number of processes. Default: None, one for each core.
        check : bool, optional
            Whether to measure the error bound of the new response. If not, nothing is solved. If
            the charges differ, the new response then has the bound of this response, and its
            `validation` and `unloaded_charges_pC` are None.
        progress : callable or bool, optional
            See `build_response`.

        Returns
        -------
        Response
            Response of the other scene. If its charges are the same, it is a copy of this response
            in which only `scene` is replaced.

        Raises
        ------
        ValueError
            If the film of the scene deforms differently, or if the charges differ and this response
            has no `stress_modes` or no `validation`.
        NotConvergedError
            If the random touches are solved again, and more than half of them cannot be solved.

        Notes
        -----
        If the charges differ, a new spline is computed from `stress_modes`, which takes seconds. If
        the electrodes are the same, the error of the spline is measured with the existing
        validation solves. The touches are solved again for other electrodes, and if this error
        bound exceeds the tolerance, since the meshes of the existing solves may be too coarse for
        the new d31 and d32.
        """
        require_same_mechanics(self.scene, scene)
        response = replace(self, scene=scene)
        if gives_same_charges(self.scene, scene):
            return response
        if self.stress_modes is None or self.validation is None:
            raise ValueError("response: has no stress about the probe; build it again")
        with show_progress("CPU seconds", progress) as show:
            runner = TaskRunner(processes, show)
            spline = tabulate_charges(
                self.stress_modes, scene, self.domain, axes=self.spline.axes, runner=runner
            )
            response = replace(response, spline=spline, sensitivities=None)
            if not check:
                return replace(response, validation=None, unloaded_charges_pC=None)
            if has_equal_electrodes(self.scene, scene):
                measured = response.with_measured_error()
                if measured.status is Status.CONVERGED:
                    return measured
            touches = self.validation.touches
            solves = [*runner.run(make_solve_tasks(scene, touches, self.tolerance))]
        validation = ValidationSolves.collect(touches, solves)
        return replace(response, validation=validation).with_measured_error()

    def with_measured_error(self, safety: float = 5.0) -> Response:
        """Return a copy with updated error bound, notes and charges of the unloaded film.

        The bound is measured with the solves in `validation`, which must not be None. If it exceeds
        the tolerance, a note says what would help; otherwise there are no notes. The unloaded film
        is solved for its charges.

        Parameters
        ----------
        safety : float, optional
            Factor on the largest error at the random touches, since errors between them may be
            larger.

        Notes
        -----
        The bound is the safety factor times the largest error relative to |d31 X| + |d32 Y|, plus
        the largest error that the full solves estimate of themselves.
        """
        assert self.validation is not None
        touches = self.validation.touches
        charges_pC, _ = self.evaluate(touches)
        errors = self.validation.compute_relative_errors(self.scene.film, charges_pC)
        bounds = safety * errors.of_charges.max(axis=1) + errors.of_solves
        bound = float(bounds.max())
        response = replace(
            self,
            error_bound=bound,
            notes=(),
            unloaded_charges_pC=_compute_finite_unloaded_charges(self.scene),
        )
        if response.status is Status.CONVERGED:
            return response
        distances = np.hypot(touches[:, TouchColumn.X], touches[:, TouchColumn.Y])
        nearest_miss_mm = distances[bounds > self.tolerance].min()
        note = (
            f"tolerance = {self.tolerance:g}: the error bound is {bound:.2g}; raise the tolerance"
            " to the bound, or reduce the reach: touches meet the tolerance up to"
            f" {nearest_miss_mm:.3g} mm"
        )
        return replace(response, notes=(note,))

    def with_sensitivities(
        self, processes: int | None = None, *, progress: Progress | bool | None = None
    ) -> Response:
        """Return a response with derivatives for the parameters in the scene's ``[calibration]``.

        They are derivatives of the charges with respect to the film's parameters, by which
        `locate` and the like include the errors of the calibration in standard deviations.

        Parameters
        ----------
        processes : int, optional
            Number of processes. Default: None, one for each core.
        progress : callable or bool, optional
            See `build_response`.

        Returns
        -------
        Response
            This response itself if it has all derivatives.

        Raises
        ------
        ValueError
            If charges have no derivative with respect to a key.
        NotConvergedError
            If too many of the solves do not converge.
        """
        keys = list_film_keys(self.scene)
        has_keys = self.sensitivities is not None and set(keys) <= set(self.sensitivities.keys)
        if not keys or has_keys:
            return self
        with show_progress("CPU seconds", progress) as show:
            runner = TaskRunner(processes, show)
            fitted = fit_sensitivities(self.scene, self.domain, keys, self.evaluate, runner)
        return replace(self, sensitivities=fitted)

    def plot(
        self,
        electrode: str,
        rotation_deg: float = 0.0,
        force_N: float = 1.0,
        ax: Axes | None = None,
    ) -> Figure:
        """Plot the charge of an electrode as a function of the probe's position.

        Parameters
        ----------
        electrode : str
            Name of the electrode.
        rotation_deg : float, optional
            Rotation of the probe.
        force_N : float, optional
            Force of the probe, within the domain.
        ax : matplotlib.axes.Axes, optional
            Axes to draw into. Default: None, those of a new figure.

        Returns
        -------
        matplotlib.figure.Figure
            Figure with coloured charges and lines of equal charge.

        Raises
        ------
        ValueError
            If the response has no electrode of this name, or the force is outside of the domain.
        """
        from pvdf_fem.view.touch_map import draw_charge_map

        if electrode not in self.names:
            known = ", ".join(self.names)
            raise ValueError(f"electrode = {electrode!r}: not in the response; choose from {known}")
        column = self.names.index(electrode)

        def evaluate_charge(positions_mm: Array) -> Array:
            """Evaluate the charge of the electrode in pC, for positions of the probe."""
            touches = np.empty((len(positions_mm), len(TOUCH_QUANTITIES)))
            touches[:, : TouchColumn.ROTATION] = positions_mm
            touches[:, TouchColumn.ROTATION] = rotation_deg
            touches[:, TouchColumn.FORCE] = force_N
            charges_pC, _ = self.evaluate(touches)
            return charges_pC[:, column]

        title = f"Charge of {electrode} by position of the probe, {force_N:g} N, {rotation_deg:g}°"
        return draw_charge_map(self.scene, self.domain.reach_mm, evaluate_charge, title, ax)

    def save(self, path: Path | str) -> None:
        """Write the response to a file.

        Parameters
        ----------
        path : path
            Path of the file. An existing file is replaced once the new one is complete.

        Raises
        ------
        FileError
            If the file is not writable.
        """
        write_response(coerce("path", path, Path), self)

    @classmethod
    def load(cls, path: Path | str) -> Response:
        """Read a response from a file that `save` has written.

        Parameters
        ----------
        path : path
            Path of the file.

        Raises
        ------
        FileError
            If the file cannot be read. It is a `ResponseError` if the file is damaged, or is not a
            response of this version.
        """
        return read_response(coerce("path", path, Path), cls)


def _compute_finite_unloaded_charges(scene: Scene) -> UnloadedCharges | None:
    """Compute the charges of the unloaded film and their errors, or None unless all are finite.

    They are NaN if the film has no unloaded equilibrium.
    """
    charges_pC, errors_pC = compute_unloaded_charges_pC(scene)
    if not (np.isfinite(charges_pC).all() and np.isfinite(errors_pC).all()):
        return None
    return tuple(charges_pC.tolist()), tuple(errors_pC.tolist())
