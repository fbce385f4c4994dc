"""The solution of a scene: status, charges with errors, fields, and the history of the solve."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from skfem import Basis, MeshTri2

from pvdf_fem.arrays import Array, finite_or_none
from pvdf_fem.electrodes.channel import make_channels
from pvdf_fem.electrodes.film_data import FilmData
from pvdf_fem.electrodes.point_values import PointValues, evaluate_along, evaluate_at
from pvdf_fem.electrodes.stress_integrals import StressIntegrals
from pvdf_fem.film.coupling import find_floating_electrodes
from pvdf_fem.film.loads.load_spec import Pressure
from pvdf_fem.film.loads.punch import Punch, PunchTilt
from pvdf_fem.problem.contact_result import ContactResult
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.arguments import coerce
from pvdf_fem.solver.discrete_solution import DiscreteSolution, find_largest_value
from pvdf_fem.solver.electrode_charges import CHARGE_PROPERTIES, ElectrodeCharges
from pvdf_fem.solver.history import MeshRecord, Stop
from pvdf_fem.solver.nonlinear.newton import Iteration
from pvdf_fem.solver.nonlinear.status import NotConvergedError, Status
from pvdf_fem.solver.summary import summarize_solution
from pvdf_fem.summary import Result, Summary, format_charges

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pandas import DataFrame
    from pyvista import Plotter


@dataclass(frozen=True, eq=False, repr=False)
class Solution(ElectrodeCharges):
    """The outcome of a solve: its status and, if it converged, charges and fields.

    Charges, fields and other results raise `NotConvergedError` without convergence.

    Attributes
    ----------
    problem : Problem
        The problem that was solved.
    status : Status
        `Status.CONVERGED`, or why there is no result.
    reason : str
        The status in words, with what to change.
    stop : Stop
        Why no further mesh was made.
    history : tuple of MeshRecord
        Records of the meshes, with unknowns, iterations, largest error and seconds.
    iterations : tuple of Iteration
        Newton iterations of the solve that led to the result.
    neglected, included : tuple of str
        Effects that the model neglects in this scene, with their estimated sizes, and effects that
        it includes in addition to those of a membrane.
    warnings : tuple of str
        Warnings, for example about a solution beyond the limits of the model.
    seconds : dict
        Wall-clock time in s of ``mesh``, ``solve``, ``estimate`` and ``refine``, and ``total``.
    unloaded_integrals : StressIntegrals or None
        Stress integrals of the electrodes on the unloaded film; None if it has no result.
    uncertainty : Uncertainty or None
        Standard deviations of the charges due to uncertain numbers of the scene, see
        `pvdf_fem.uncertainty`; None without uncertain numbers.

    Examples
    --------
    >>> solution = solve(Scene.example("triangle"))
    >>> solution.charges_pC["A"], solution.charge_errors_pC["A"]
    >>> solution.to_xarray(step_mm=1.0).deflection_mm.plot()
    """

    problem: Problem
    status: Status
    reason: str
    stop: Stop = Stop.NO_EQUILIBRIUM
    history: tuple[MeshRecord, ...] = ()
    iterations: tuple[Iteration, ...] = ()
    neglected: tuple[str, ...] = ()
    included: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    seconds: dict[str, float] = field(default_factory=dict)
    _discrete: DiscreteSolution | None = None
    unloaded_integrals: StressIntegrals | None = None
    uncertainty: Result | None = None

    @property
    def pressure(self) -> Pressure | None:
        """The pressure function that replaces ``load.profile``; None if there is none."""
        return self.problem.pressure

    @property
    def discrete(self) -> DiscreteSolution:
        """The converged solution on its mesh; raises `NotConvergedError` if there is none."""
        if self._discrete is None or self.status is not Status.CONVERGED:
            raise NotConvergedError(f"{self.status}: {self.reason}")
        return self._discrete

    @property
    def mesh(self) -> MeshTri2:
        """Mesh of the whole film in m, with the patches as subdomains."""
        return self.discrete.equilibrium.space.mesh

    @property
    def basis(self) -> Basis:
        """Scalar basis on `mesh` that all three displacement components use."""
        return self.discrete.equilibrium.space.basis

    @property
    def displacement(self) -> Array:
        """Displacement u, v, w in m at the dofs of `basis`, shape (dofs, 3)."""
        return self.discrete.displacement.reshape(-1, 3)

    @property
    def deflection_max_mm(self) -> float:
        """Largest absolute deflection in mm, also between the nodes."""
        discrete = self.discrete
        deflection = discrete.solved_dofs[2::3]
        return 1e3 * find_largest_value(discrete.solved.space.basis, deflection)

    @property
    def punches(self) -> dict[str, PunchTilt]:
        """Tilts and moments of rigid punches by patch: ``probe``, or ``probe 1``, ``probe 2``.

        It is empty without rigid punches.
        """
        equilibrium = self.discrete.equilibrium
        state = self.discrete.state
        forces = equilibrium.unbalanced_forces(state)
        tilts = {}
        for load in equilibrium.loads:
            if not isinstance(load, Punch):
                continue
            tilt = load.compute_tilt(state, forces)
            if tilt is not None:
                tilts[load.spec.patch] = tilt
        return tilts

    @property
    def contacts(self) -> dict[str, ContactResult]:
        """Contacts of tips by patch, ``probe`` or ``probe 1``, ``probe 2``; empty without tips."""
        return self.discrete.contacts

    @property
    def force_balance(self) -> float:
        """Relative difference of the reactions and the applied force, along this force.

        The reactions are those of the rim and of a backing.

        It is 0 if the total applied force is zero.
        """
        equilibrium = self.discrete.solved
        state = self.discrete.solved_state
        applied = float(np.linalg.norm(equilibrium.applied_force(state)))
        return equilibrium.imbalance(state) / applied if applied else 0.0

    @property
    def unknowns(self) -> int:
        """Number of equations on the mesh of the result; 0 if there is no mesh.

        The mesh may cover only a symmetry sector of the film.
        """
        return self._discrete.solved.unknowns.count if self._discrete else 0

    def at(
        self, x_mm: ArrayLike, y_mm: ArrayLike, outside: Literal["refuse", "nan"] = "refuse"
    ) -> PointValues:
        """Evaluate the fields at points on the film.

        Parameters
        ----------
        x_mm, y_mm : float or array_like
            Coordinates in mm, which are broadcast against each other.
        outside : str, optional
            ``"refuse"`` raises a ValueError for points that are not on the film; ``"nan"`` returns
            NaN there.

        Returns
        -------
        PointValues
            Displacement, slopes, strain, stress and charge density at the points.

        Raises
        ------
        ValueError
            If a point is not on the film, unless `outside` is ``"nan"``.
        """
        discrete = self.discrete
        return evaluate_at(discrete.equilibrium, discrete.state, x_mm, y_mm, outside=outside)

    def along(self, line_mm: ArrayLike, points: int = 200) -> PointValues:
        """Evaluate the fields at points along a line.

        Parameters
        ----------
        line_mm : array_like, shape (corners, 2)
            Two or more corners ``((x0, y0), (x1, y1), ...)`` in mm.
        points : int, optional
            Number of points, including both ends.

        Returns
        -------
        PointValues
            Values like those of `at`.
        """
        discrete = self.discrete
        return evaluate_along(discrete.equilibrium, discrete.state, line_mm, points=points)

    def to_xarray(self, step_mm: float = 0.5) -> xarray.Dataset:
        """Evaluate the fields on a grid that covers the film, with NaN outside the film.

        Parameters
        ----------
        step_mm : float, optional
            Distance between neighbouring points in mm.

        Returns
        -------
        xarray.Dataset
            ``deflection_mm``, ``charge_density_pC_mm2`` (y_mm, x_mm), and with named components
            ``displacement_mm``, ``slopes``, ``strain`` and ``stress_MPa`` (y_mm, x_mm, ...).
        """
        from pvdf_fem.view.field_grid import make_field_dataset, make_grid_coordinates

        left_mm, low_mm, right_mm, high_mm = self.scene.film.bounds_mm
        x_mm = make_grid_coordinates(left_mm, right_mm, step_mm)
        y_mm = make_grid_coordinates(low_mm, high_mm, step_mm)
        values = self.at(x_mm[None], y_mm[:, None], outside="nan")
        return make_field_dataset(values, self.scene.to_toml())

    def to_json(self) -> dict[str, Any]:
        """Return the dict that ``pvdf-fem solve --json`` prints.

        It has a ``reason`` in place of charges and other results if the solve did not converge.
        """
        results: dict[str, Any] = {"reason": self.reason}
        if self.status is Status.CONVERGED:
            results = self._convert_results_to_json()
        return {
            "status": str(self.status),
            **results,
            "observable": self.scene.numerics.observable,
            "unknowns": self.unknowns,
            "newton_iterations": len(self.iterations),
            "neglected": list(self.neglected),
            "included": list(self.included),
            "warnings": list(self.warnings),
            "seconds": self.seconds,
            "stop": self.stop.value,
            "history": [record.to_json() for record in self.history],
        }

    def _convert_results_to_json(self) -> dict[str, Any]:
        """Return charges and other results of a converged solve for JSON.

        Charges that are NaN for any electrode are None.
        """
        results: dict[str, Any] = {}
        for name in CHARGE_PROPERTIES:
            results[name] = _discard_values_with_nan(getattr(self, name))
        results["deflection_max_mm"] = self.deflection_max_mm
        results["force_balance"] = self.force_balance
        if self.contacts:
            results["contacts"] = {
                patch: contact.to_json() for patch, contact in self.contacts.items()
            }
        punches = self.punches
        if punches:
            results["punches"] = {patch: asdict(tilt) for patch, tilt in punches.items()}
        if find_floating_electrodes(self.scene):
            results["electrode_voltages_V"] = _discard_values_with_nan(self.electrode_voltages_V)
        if self.scene.readout is not None:
            results["readings_V"] = _discard_values_with_nan(self.readings_V)
            results["time_constants_s"] = {
                channel.name: finite_or_none(channel.time_constant)
                for channel in make_channels(self.scene)
            }
        if self.uncertainty:
            results["uncertainty"] = self.uncertainty.to_json()
        return results

    def _headline(self) -> str:
        """Return status, size and charges, or the reason for a failure, in one line."""
        outcome = self.reason
        if self.status is Status.CONVERGED:
            outcome = format_charges(self.charges_pC)
        return f"{self.status}, {self.unknowns} unknowns, {len(self.history)} meshes: {outcome}"

    def summary(self) -> Summary:
        """Return the content that `print` and notebooks show."""
        return summarize_solution(self.to_json(), self.uncertainty)

    # The methods below import their modules, which are slow to import, when they are called.
    def plot(
        self, quantity: str = "deflection", ax: Axes | None = None, reach_mm: float | None = None
    ) -> Figure:
        """Draw a map of the film with electrodes, charges and probes.

        Parameters
        ----------
        quantity : str, optional
            ``deflection``, ``stress`` (S11 + S22), ``charge density``, ``principal directions``,
            ``mesh``, ``error`` (contributions of elements to the errors of charges) or
            ``contact`` (pressure of tips). Fields with both signs are white at zero.
        ax : Axes, optional
            Axes to draw on, by default those of a new figure.
        reach_mm : float, optional
            Half the width of the map in mm. By default the map shows the whole film.

        Returns
        -------
        Figure

        Raises
        ------
        ValueError
            If the quantity is unknown or this scene does not have it.
        """
        from pvdf_fem.view.film_map import draw_film_map

        return draw_film_map(self.film_data(), quantity, ax, reach_mm=reach_mm)

    def view(
        self,
        quantity: str = "deflection",
        scale: float | None = None,
        html: str | Path | None = None,
    ) -> Plotter:
        """Draw the deflected film in 3-D; this needs ``pip install pvdf-fem[view]``.

        Parameters
        ----------
        quantity : str, optional
            Field that colours the film, one of the fields of `plot`.
        scale : float, optional
            Factor on the displacements. By default the largest deflection is drawn as a quarter of
            the film's radius.
        html : path, optional
            File to which the view is also written as a page for any browser, without a server.

        Returns
        -------
        Plotter
            Call ``show()`` to open a window, or to show the film in a notebook.

        Raises
        ------
        ImportError
            If rendering is not possible; the text says what to install.
        FileError
            If the page cannot be written.
        ValueError
            If the quantity is not a field, is unknown, or if this scene does not have it.
        """
        from pvdf_fem.view.film_view import make_film_view

        return make_film_view(self.film_data(), quantity, scale=scale, html=html)

    def to_dataframe(self) -> DataFrame:
        """Return a table with a row for each electrode: charges and errors in pC.

        With ``[readout]`` there are also readings in V.
        """
        from pandas import DataFrame

        names = list(CHARGE_PROPERTIES)
        if self.scene.readout:
            names.append("readings_V")
        columns = {name: getattr(self, name) for name in names}
        return DataFrame(columns).rename_axis("electrode")

    def to_vtu(self, path: str | Path, cells: Literal["linear", "six-node"] = "linear") -> None:
        """Write displacement, stresses, charge densities, patches and the scene to a VTU file.

        Parameters
        ----------
        path : path
            File to write, with the extension ``.vtu``.
        cells : {"linear", "six-node"}, optional
            ``"linear"`` writes linear triangles that tile the curved elements, which VTK, ParaView
            and pyvista sample and integrate right. ``"six-node"`` writes the elements themselves.

        Raises
        ------
        FileError
            If the path has another extension, or if the file cannot be written.
        ValueError
            If `cells` is none of the two.
        """
        from pvdf_fem.view.files.vtu import VtuCells, write_vtu

        cells = coerce("cells", cells, VtuCells)
        write_vtu(self.film_data(), coerce("path", path, Path), cells)

    def film_data(self) -> FilmData:
        """Return the fields and charges that `plot`, `view` and `to_vtu` show.

        The contributions of elements to errors are computed only when they are used.
        """
        # imported here since it imports the solvers, which the rest of this module does not need
        from pvdf_fem.solver.estimate.next_order import compute_error_contributions

        discrete = self.discrete
        return FilmData(
            discrete.equilibrium,
            discrete.state,
            unknowns=self.unknowns,
            charges_pC=self.charges_pC,
            charge_errors_pC=self.charge_errors_pC,
            rest_charges_pC=self.rest_charges_pC,
            contacts=self.contacts,
            included=self.included,
            error_contributions=partial(
                compute_error_contributions, discrete, self.problem.outputs
            ),
        )


def _discard_values_with_nan(values: dict[str, float]) -> dict[str, float] | None:
    """Return the values, or None if any of them is NaN, which JSON does not have."""
    is_unknown = any(math.isnan(value) for value in values.values())
    return None if is_unknown else values
