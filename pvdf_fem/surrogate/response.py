"""The charges of a sensor as a function of the touch: place, rotation and force of one probe.

A response is a table of spline coefficients, which `build.build_response` makes from a few dozen
solves. Its error is measured against full solves of random touches. It keeps the stress about the
probe, from which the table is made anew for other electrodes, d31 and d32.
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

# Rows of the products (value and derivatives by x, y, rotation) x (value and derivative by force):
# the value, and the derivatives by x, y, rotation and force.
_VALUE_AND_SLOPES: Indices = np.array([0, 2, 4, 6, 1])


@dataclass(frozen=True, eq=False, repr=False)
class Response(Result):
    """Charges of the electrodes by the touch.

    Examples
    --------
    >>> response = build_response("sensor.toml", tolerance=3e-2)
    >>> response.save("model.npz")
    >>> charges_pC, derivatives = response.evaluate([[2.0, 1.0, 0.0, 0.5]])  # x, y, rotation, force
    """

    quantities: ClassVar[tuple[str, ...]] = TOUCH_QUANTITIES  #: Of one probe.
    is_fast: ClassVar[bool] = True
    #: Film, electrodes and probe; the probe's place and the force do not matter.
    scene: FileScene
    domain: Domain
    #: Bound on the error of a charge over |d31 X| + |d32 Y|: five times the largest error at the
    #: random touches whose full solves it was compared with.
    error_bound: float
    #: Over x in mm, y in mm and rotation in degrees: coefficients in pC of powers of the scaled
    #: force, ordered by power, then by electrode, (powers electrodes,).
    spline: UniformSpline
    #: The error bound that was asked for.
    tolerance: float = 1e-3
    #: What to know of it, and what would help where the bound exceeds the tolerance.
    remarks: tuple[str, ...] = ()
    stress_modes: StressModes | None = None
    validation: ValidationSolves | None = None
    unloaded_charges_pC: UnloadedCharges | None = None

    def summary(self) -> Summary:
        """Electrodes and domain, the error bound, and remarks."""
        about = f"charges of {', '.join(self.names)} for {self.domain}"
        notes = [f"errors: up to {self.error_bound:.2g} of a charge", *self.remarks]
        return Summary(self.status, [about], notes=notes)

    def to_json(self) -> dict[str, Any]:
        """What `pvdf-fem model --json` prints besides the file."""
        return {
            "electrodes": list(self.names),
            "reach_mm": self.domain.reach_mm,
            "force_range_N": list(self.domain.force_N),
            "error_bound": self.error_bound,
            "remarks": list(self.remarks),
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
        """Total charges in pC, (n, electrodes), and their derivatives by x, y, rotation and force.

        The derivatives (n, electrodes, 4) are in pC per mm, degree and N. `touches` (n, 4) are x
        and y in mm, rotation in degrees and force in N. Raises `ValueError` outside of the domain.
        """
        touches = coerce_array("touches", touches).reshape(-1, len(TOUCH_QUANTITIES))
        require_within(self.domain, touches)
        # (n, value and derivatives by place, powers, electrodes)
        by_place = self.spline.with_gradient(touches[:, : TouchColumn.FORCE])
        by_place = by_place.reshape(len(touches), 4, -1, len(self.names))
        by_force = evaluate_force_powers(
            self.domain, touches[:, TouchColumn.FORCE], by_place.shape[2]
        )
        # (n, value and derivatives by place x value and derivative by force, electrodes)
        products = np.matmul(by_force[:, None], by_place).reshape(len(touches), 8, -1)
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
        """The response of a scene that differs in what only reads the stress about the probe.

        That is electrodes, d31, d32, readout, stage, and the place of the probe and the force,
        which do not matter. The table is made anew, in seconds, and its error bound is measured by
        the full solves that the build had. For other electrodes, and where the meshes for the old
        d31 and d32 leave the bound above the tolerance, the same touches are solved anew. Without
        a `check` nothing is solved: the error bound stays the bound of this response. `progress` is
        as for `build_response`. Raises `ValueError` for a scene whose film deforms otherwise, and
        `NotConvergedError` when half of the touches fail.
        """
        require_same_mechanics(self.scene, scene)
        made = replace(self, scene=scene)
        if has_same_readout(self.scene, scene):
            return made
        if self.stress_modes is None or self.validation is None:
            raise ValueError("response: keeps no stress about the probe; build it again")
        with show_progress("s of one core", progress) as show:
            work = TaskRunner(processes, show)
            axes = self.spline.axes
            made = replace(
                made, spline=tabulate_charges(self.stress_modes, scene, self.domain, axes, work)
            )
            if not check:
                return replace(made, validation=None, unloaded_charges_pC=None)
            if has_equal_electrodes(self.scene, scene):
                kept = made.measured()
                if kept.status is Status.CONVERGED:
                    return kept
            touches = self.validation.touches
            found = [*work.run(make_solve_tasks(scene, touches, self.tolerance))]
        return replace(made, validation=ValidationSolves.of(touches, found)).measured()

    def measured(self, safety: float = 5.0) -> Response:
        """This response with the error that it has at the touches held out: the bound is the
        largest error times `safety`, and the error of the full solves."""
        assert self.validation is not None
        touches = self.validation.touches
        errors, stated = self.validation.relative_errors(self.scene.film, self.evaluate(touches)[0])
        bounds = safety * errors.max(axis=1) + stated
        bound, rest = float(bounds.max()), compute_unloaded_charges_pC(self.scene)
        at_rest: UnloadedCharges = (tuple(rest[0].tolist()), tuple(rest[1].tolist()))
        known = at_rest if np.isfinite(rest).all() else None
        made = replace(self, error_bound=bound, remarks=(), unloaded_charges_pC=known)
        if made.status is Status.CONVERGED:
            return made
        met = np.hypot(touches[:, 0], touches[:, 1])[bounds > self.tolerance].min()
        remark = (
            f"tolerance: {self.tolerance:g} is missed, the error bound is {bound:.2g}; raise"
            f" the tolerance to it, or lower the reach: touches meet it up to {met:.3g} mm"
        )
        return replace(made, remarks=(remark,))

    def plot(
        self,
        electrode: str,
        rotation_deg: float = 0.0,
        force_N: float = 1.0,
        ax: Axes | None = None,
    ) -> Figure:
        """Draw the charge of an electrode by the place of the probe, with lines of equal charge."""
        from pvdf_fem.view.touch_map import draw_charge_map

        if electrode not in self.names:
            known = ", ".join(self.names)
            raise ValueError(f"electrode {electrode!r}: is none of the response; give {known}")
        touch, number = [rotation_deg, force_N], self.names.index(electrode)

        def charge(places_mm: Array) -> Array:
            touches = np.hstack([places_mm, np.tile(touch, (len(places_mm), 1))])
            return self.evaluate(touches)[0][:, number]

        title = f"Charge of {electrode} by the probe's place, {force_N:g} N, {rotation_deg:g}°"
        return draw_charge_map(self.scene, self.domain.reach_mm, charge, title, ax)

    def save(self, path: Path | str) -> None:
        """Write the response to a file, which replaces an older one only when it is complete."""
        write_response(coerce("path", path, Path), self)

    @classmethod
    def load(cls, path: Path | str) -> Response:
        """Read a response; raises `ResponseError`, a `FileError`, for what holds no sound one."""
        return read_response(coerce("path", path, Path), cls)
