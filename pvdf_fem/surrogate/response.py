"""The charges of a sensor as a function of the touch: place, rotation and force of one probe.

A response is a spline, which `build_response` makes from a few dozen solves. Its error is measured
against full solves of random touches. It keeps the stress about the probe, from which the spline is
made anew for other electrodes, d31 and d32.
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
from pvdf_fem.surrogate.charge_spline import evaluate_force_powers, tabulate_charges
from pvdf_fem.surrogate.response_file import FileScene, read_response, write_response
from pvdf_fem.surrogate.response_key import (
    has_equal_electrodes,
    has_same_readout,
    require_same_mechanics,
)
from pvdf_fem.surrogate.stress.stress_modes import StressModes
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, Domain, TouchColumn, require_within
from pvdf_fem.surrogate.uniform_spline import UniformSpline
from pvdf_fem.surrogate.validation_solves import ValidationSolves, make_solve_tasks

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Rows of the products (value and derivatives by x, y, rotation) x (value and derivative by force)
# that are the value, and the derivatives by x, y, rotation and force.
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

    #: Names of a touch's quantities.
    quantity_names: ClassVar[tuple[str, ...]] = TOUCH_QUANTITIES
    #: Whether thousands of evaluations take less than a second.
    is_fast: ClassVar[bool] = True
    #: Film, electrodes and probe; the probe's place and the force have no effect.
    scene: FileScene
    #: Touches for which the response is valid.
    domain: Domain
    #: Bound on the error of a charge over |d31 X| + |d32 Y|: five times the largest error at the
    #: random touches with a full solve, and the error of these solves.
    error_bound: float
    #: Over x in mm, y in mm and rotation in degrees: coefficients in pC of powers of the scaled
    #: force, ordered by power, then by electrode, (powers electrodes,).
    spline: UniformSpline
    #: The largest error bound that was requested.
    tolerance: float = 1e-3
    #: Notes on the build, and changes that would help if the bound exceeds the tolerance.
    notes: tuple[str, ...] = ()
    #: The stress about the probe, for responses of other electrodes.
    stress_modes: StressModes | None = None
    #: The full solves with which the error was measured.
    validation: ValidationSolves | None = None
    #: Charges of the unloaded film in pC and their errors, if it has an unloaded equilibrium.
    unloaded_charges_pC: UnloadedCharges | None = None

    def summary(self) -> Summary:
        """Return the electrodes, the domain, the error bound and the notes."""
        about = f"charges of {', '.join(self.names)} for {self.domain}"
        lines = [f"errors: up to {self.error_bound:.2g} of a charge", *self.notes]
        return Summary(self.status, [about], notes=lines)

    def to_json(self) -> dict[str, Any]:
        """Return the values that `pvdf-fem model --json` prints besides the file."""
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
        """Whether the error bound is within the tolerance."""
        return Status.CONVERGED if self.error_bound <= self.tolerance else Status.TOLERANCE

    def evaluate(self, touches: ArrayLike) -> tuple[Array, Array]:
        """Evaluate the total charges of touches and their derivatives.

        Parameters
        ----------
        touches : array_like, shape (n, 4)
            Rows of x and y in mm, rotation in degrees and force in N.

        Returns
        -------
        charges : ndarray, shape (n, electrodes)
            In pC.
        derivatives : ndarray, shape (n, electrodes, 4)
            By x, y, rotation and force, in pC per mm, degree and N.

        Raises
        ------
        ValueError
            For touches outside of the domain.
        """
        touches = coerce_array("touches", touches).reshape(-1, len(TOUCH_QUANTITIES))
        require_within(self.domain, touches)
        count = len(touches)
        # (n, value and derivatives by place, powers, electrodes)
        by_place = self.spline.evaluate_with_gradient(touches[:, : TouchColumn.FORCE])
        by_place = by_place.reshape(count, 4, -1, len(self.names))
        forces_N = touches[:, TouchColumn.FORCE]
        by_force = evaluate_force_powers(self.domain, forces_N, by_place.shape[2])
        # (n, value and derivatives by place x value and derivative by force, electrodes)
        products = np.matmul(by_force[:, None], by_place).reshape(count, 8, -1)
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
        """Make the response of a scene with the same stress about its probe.

        The scene may differ in electrodes, d31, d32, readout and stage, and in the place of the
        probe and the force, which have no effect.

        Parameters
        ----------
        scene : Scene
            The other scene.
        processes : int, optional
            Number of processes; by default all cores.
        check : bool, optional
            Whether the error bound is measured anew. Otherwise nothing is solved, and the bound is
            that of this response.
        progress : callable or bool, optional
            As for `build_response`.

        Raises
        ------
        ValueError
            For a scene whose film deforms otherwise.
        NotConvergedError
            When more than half of the random touches have no solution.

        Notes
        -----
        The spline is made anew, which takes seconds. Its error bound is measured with the full
        solves of the build. For other electrodes, and where the meshes for the old d31 and d32
        leave the bound above the tolerance, the same touches are solved anew.
        """
        require_same_mechanics(self.scene, scene)
        response = replace(self, scene=scene)
        if has_same_readout(self.scene, scene):
            return response
        if self.stress_modes is None or self.validation is None:
            raise ValueError("response: keeps no stress about the probe; build it again")
        with show_progress("s of one core", progress) as show:
            runner = TaskRunner(processes, show)
            spline = tabulate_charges(
                self.stress_modes, scene, self.domain, axes=self.spline.axes, runner=runner
            )
            response = replace(response, spline=spline)
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
        """Return this response with the error bound that follows from its validation solves.

        Parameters
        ----------
        safety : float, optional
            The bound is the largest error times this factor, plus the error of the full solves.
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
            f"tolerance = {self.tolerance:g}: exceeded by the error bound {bound:.2g}; raise the"
            " tolerance to the bound, or lower the reach: touches meet the tolerance up to"
            f" {nearest_miss_mm:.3g} mm"
        )
        return replace(response, notes=(note,))

    def plot(
        self,
        electrode: str,
        rotation_deg: float = 0.0,
        force_N: float = 1.0,
        ax: Axes | None = None,
    ) -> Figure:
        """Draw the charge of an electrode by the place of the probe, with lines of equal charge.

        Parameters
        ----------
        electrode : str
            Name of the electrode.
        rotation_deg, force_N : float, optional
            Rotation and force of the probe.
        ax : matplotlib.axes.Axes, optional
            Where to draw; by default in a new figure.

        Raises
        ------
        ValueError
            If the response has no such electrode.
        """
        from pvdf_fem.view.touch_map import draw_charge_map

        if electrode not in self.names:
            known = ", ".join(self.names)
            raise ValueError(f"electrode = {electrode!r}: not in the response; choose from {known}")
        column = self.names.index(electrode)

        def evaluate_charge(places_mm: Array) -> Array:
            touches = np.empty((len(places_mm), len(TOUCH_QUANTITIES)))
            touches[:, : TouchColumn.ROTATION] = places_mm
            touches[:, TouchColumn.ROTATION] = rotation_deg
            touches[:, TouchColumn.FORCE] = force_N
            charges_pC, _ = self.evaluate(touches)
            return charges_pC[:, column]

        title = f"Charge of {electrode} by the probe's place, {force_N:g} N, {rotation_deg:g}°"
        return draw_charge_map(self.scene, self.domain.reach_mm, evaluate_charge, title, ax)

    def save(self, path: Path | str) -> None:
        """Write the response to a file, which replaces an older one only when it is complete.

        Raises
        ------
        FileError
            If the file is not writable.
        """
        write_response(coerce("path", path, Path), self)

    @classmethod
    def load(cls, path: Path | str) -> Response:
        """Read a response from a file.

        Raises
        ------
        ResponseError
            A `FileError`: for a damaged file, and for one without a response of this version.
        """
        return read_response(coerce("path", path, Path), cls)


def _compute_finite_unloaded_charges(scene: Scene) -> UnloadedCharges | None:
    """Compute the charges of the unloaded film; None for a film without an unloaded equilibrium."""
    charges_pC, errors_pC = compute_unloaded_charges_pC(scene)
    if not (np.isfinite(charges_pC).all() and np.isfinite(errors_pC).all()):
        return None
    return tuple(charges_pC.tolist()), tuple(errors_pC.tolist())
