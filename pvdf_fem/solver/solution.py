"""What a solve returns: its status, its charges with errors, and how it went."""

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
from pvdf_fem.electrodes.channel import compute_readings_V, make_channels
from pvdf_fem.electrodes.film_data import FilmData
from pvdf_fem.electrodes.heat import compute_heat_charges
from pvdf_fem.electrodes.point_values import PointValues, evaluate_along, evaluate_at
from pvdf_fem.electrodes.stress_integrals import StressIntegrals
from pvdf_fem.electrodes.thickness import compute_thickness_charges
from pvdf_fem.film.coupling import find_floating_electrodes
from pvdf_fem.film.loads.load_spec import Pressure
from pvdf_fem.film.loads.punch import Punch, PunchTilt
from pvdf_fem.problem.contact_result import ContactResult
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.arguments import ValuesByName, coerce, coerce_array
from pvdf_fem.scene.scene import Scene, SceneError
from pvdf_fem.solver.discrete_solution import DiscreteSolution, find_largest_value
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


KINDS = "charge", "rest_charge", "charge_change"
CHARGES = tuple(f"{kind}{end}" for kind in KINDS for end in ("s_pC", "_errors_pC"))


@dataclass(frozen=True, eq=False, repr=False)
class Solution(Result):
    """How a solve ended and, if it converged, its fields and charges.

    Examples
    --------
    >>> solution = solve(Scene.example("triangle"))
    >>> solution.charges_pC["A"], solution.charge_errors_pC["A"]
    >>> solution.to_xarray(step_mm=1.0).deflection_mm.plot()
    """

    problem: Problem
    status: Status  #: `Status.CONVERGED`, or why there is no result.
    reason: str  #: The status in words, with what to change.
    stop: Stop = Stop.NO_EQUILIBRIUM  #: Why no further mesh was made.
    #: Every mesh with its unknowns, iterations, worst error and seconds.
    history: tuple[MeshRecord, ...] = ()
    iterations: tuple[Iteration, ...] = ()  #: Newton's table on the last mesh.
    #: What the model neglects in this scene; what it has beyond the membrane; what to look at.
    neglected: tuple[str, ...] = ()
    included: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    #: ``mesh``, ``solve``, ``estimate``, ``refine`` and ``total``.
    seconds: dict[str, float] = field(default_factory=dict)
    _discrete: DiscreteSolution | None = None
    #: Stress integrals of the electrodes on the unloaded film, if they are known.
    unloaded_integrals: StressIntegrals | None = None
    #: Deviations by the scene's uncertain numbers, from `pvdf_fem.uncertainty`.
    uncertainty: Result | None = None

    @property
    def scene(self) -> Scene:
        """The scene that was solved."""
        return self.problem.scene

    @property
    def pressure(self) -> Pressure | None:
        """Pressure in Python in place of the scene's ``load.profile``."""
        return self.problem.pressure

    @property
    def discrete(self) -> DiscreteSolution:
        """The converged solution on its mesh; raises `NotConvergedError`."""
        if self._discrete is None or self.status is not Status.CONVERGED:
            raise NotConvergedError(f"{self.status}: {self.reason}")
        return self._discrete

    @property
    def mesh(self) -> MeshTri2:
        """Mesh in metres, with the patches as subdomains."""
        return self.discrete.equilibrium.space.mesh

    @property
    def basis(self) -> Basis:
        """Scalar basis of each displacement component."""
        return self.discrete.equilibrium.space.basis

    @property
    def displacement(self) -> Array:
        """u, v, w in m at the dofs of `basis`, (dofs, 3)."""
        return self.discrete.displacement.reshape(-1, 3)

    @property
    def charges_pC(self) -> dict[str, float]:
        """Total charge by electrode: by the pretension, by the touch and, where the film has values
        for them, by the probe's pressure and heat."""
        film, fields = self.scene.film, self.discrete
        charges = fields.stress_integrals.charges(self._coefficients)
        if film.pyroelectric_uC_m2K is not None:
            charges += 1e12 * compute_heat_charges(self.problem, fields.solved)
        if film.d33_pC_N is not None:
            charges += 1e12 * compute_thickness_charges(fields.equilibrium, fields.state)
        return self._by_electrode(charges)

    @property
    def charge_errors_pC(self) -> dict[str, float]:
        """Estimated charge errors, absolute: by the mesh or by wrinkles, whichever is larger.

        Wrinkles would occur in a real film where the computed film is in compression.
        """
        return self.charge_errors_by(*self._coefficients)

    @property
    def rest_charges_pC(self) -> dict[str, float]:
        """Electrode charges of the untouched film before warming; NaN, like the changes, where the
        untouched film has no result (a warning reports the failure)."""
        return self._by_electrode(self._rest.charges(self._coefficients))

    @property
    def rest_charge_errors_pC(self) -> dict[str, float]:
        """Estimated error of each charge at rest; 0 where the untouched film is flat."""
        return self._by_electrode(self._rest.charge_errors(self._coefficients))

    @property
    def charge_changes_pC(self) -> dict[str, float]:
        """Charge added by the touch, by electrode: a zeroed charge amplifier sees this change."""
        rest = self.rest_charges_pC
        return {name: charge - rest[name] for name, charge in self.charges_pC.items()}

    @property
    def charge_change_errors_pC(self) -> dict[str, float]:
        """Estimated errors of the changes: the errors of both charges, added up."""
        rest = self.rest_charge_errors_pC
        return {name: error + rest[name] for name, error in self.charge_errors_pC.items()}

    @property
    def _rest(self) -> StressIntegrals:
        return self.unloaded_integrals or StressIntegrals.unknown(len(self.scene.electrode_list))

    @property
    def _coefficients(self) -> tuple[float, float]:
        return self.scene.film.d31_pC_N, self.scene.film.d32_pC_N

    @property
    def readings_V(self) -> dict[str, float]:
        """Readings in V by channel in ``[readout]``, just after a sudden touch.

        The reading decays with the channel's time constant, see
        `pvdf_fem.electrodes.channel.Channel`.
        """
        if self.scene.readout is None:
            raise SceneError(["readout = (nothing): is required by readings; add [readout]"])
        both = ([*charges.values()] for charges in (self.charges_pC, self.charge_changes_pC))
        return self._by_electrode(compute_readings_V(self.scene, *both))

    @property
    def electrode_voltages_V(self) -> dict[str, float]:
        """Voltage by electrode after a sudden touch, before the amplifier (no reading): zero under
        a charge amplifier, else the charge over the capacitance of electrode and cable, with the
        charge's sign."""
        capacitances = {channel.name: channel.capacitance for channel in make_channels(self.scene)}
        wired = {electrode.name for electrode in find_floating_electrodes(self.scene)}
        changes = self.charge_changes_pC.items()
        return {n: 1e-12 * q / capacitances[n] if n in wired else 0.0 for n, q in changes}

    def charges_by(self, d31_pC_N: float, d32_pC_N: float) -> dict[str, float]:
        """Charges in pC by the stress with other coefficients, without heat's and d33's charges."""
        coefficients = coerce_array("d31_pC_N, d32_pC_N", [d31_pC_N, d32_pC_N])
        return self._by_electrode(self.discrete.stress_integrals.charges(coefficients))

    def charge_errors_by(self, d31_pC_N: float, d32_pC_N: float) -> dict[str, float]:
        """Estimated errors in pC of `charges_by`."""
        return self._by_electrode(
            self.discrete.stress_integrals.charge_errors((d31_pC_N, d32_pC_N))
        )

    def _by_electrode(self, values: Array) -> dict[str, float]:
        names = [electrode.name for electrode in self.scene.electrode_list]
        return ValuesByName(zip(names, values.tolist(), strict=True))

    @property
    def deflection_max_mm(self) -> float:
        """Largest deflection."""
        fields = self.discrete
        return 1e3 * find_largest_value(fields.solved.space.basis, fields.solved_dofs[2::3])

    @property
    def punches(self) -> dict[str, PunchTilt]:
        """How rigid punches lean and are held, by patch: ``probe``, or ``probe 1``, ``probe 2``."""
        film, state = self.discrete.equilibrium, self.discrete.state
        forces = film.film_forces(state)
        told = {
            load.spec.patch: load.compute_tilt(state, forces)
            for load in film.loads
            if isinstance(load, Punch)
        }
        return {patch: leaning for patch, leaning in told.items() if leaning}

    def at(
        self, x_mm: ArrayLike, y_mm: ArrayLike, outside: Literal["refuse", "nan"] = "refuse"
    ) -> PointValues:
        """Values at points on the film: coordinates are numbers or arrays.

        Raises ValueError, which names the first one, for points that are not on the film, unless
        values `outside` shall be ``"nan"``.
        """
        return evaluate_at(self.discrete.equilibrium, self.discrete.state, x_mm, y_mm, outside)

    def to_xarray(self, step_mm: float = 0.5) -> xarray.Dataset:
        """The fields on a square grid about the film's centre, NaN off the film.

        Parameters
        ----------
        step_mm : float
            Distance of the grid's points.

        Returns
        -------
        xarray.Dataset
            ``deflection_mm``, ``charge_density_pC_mm2`` (y_mm, x_mm), and with named components
            ``displacement_mm``, ``slopes``, ``strain`` and ``stress_MPa`` (y_mm, x_mm, ...).
        """
        from pvdf_fem.view.field_grid import make_field_dataset, make_grid_coordinates

        x_mm = make_grid_coordinates(self.scene.film.radius_mm, step_mm)
        values = self.at(x_mm[None], x_mm[:, None], outside="nan")
        return make_field_dataset(values, self.scene.to_toml())

    def along(self, line_mm: ArrayLike, points: int = 200) -> PointValues:
        """Values at equally spaced points, ends included, on a line in mm through two or more
        corners ``((x0, y0), (x1, y1), ...)``."""
        return evaluate_along(self.discrete.equilibrium, self.discrete.state, line_mm, points)

    @property
    def contacts(self) -> dict[str, ContactResult]:
        """Contacts by the tip's patch: ``probe``, or ``probe 1``, ..."""
        return self.discrete.contacts

    @property
    def force_balance(self) -> float:
        """|rim reaction + applied force|, along the applied force, over it."""
        equilibrium, state = self.discrete.solved, self.discrete.solved_state
        applied = float(np.linalg.norm(equilibrium.applied_force(state)))
        return equilibrium.imbalance(state) / applied if applied else 0.0

    @property
    def unknowns(self) -> int:
        """Number of equations on the last mesh, perhaps on a part of the film."""
        return self._discrete.solved.unknowns.count if self._discrete else 0

    def to_json(self) -> dict[str, Any]:
        """What `pvdf-fem solve --json` prints; without results unless converged."""
        results: dict[str, Any] = {"reason": self.reason}
        if self.status is Status.CONVERGED:
            results = {
                **{name: _known(getattr(self, name)) for name in CHARGES},
                "deflection_max_mm": self.deflection_max_mm,
                "force_balance": self.force_balance,
            }
            if self.contacts:
                results["contacts"] = {name: c.to_json() for name, c in self.contacts.items()}
            if punches := self.punches:
                results["punches"] = {name: asdict(punch) for name, punch in punches.items()}
            if find_floating_electrodes(self.scene):
                results["electrode_voltages_V"] = _known(self.electrode_voltages_V)
            if self.scene.readout is not None:
                results["readings_V"] = _known(self.readings_V)
                results["time_constants_s"] = {
                    channel.name: finite_or_none(channel.time_constant)
                    for channel in make_channels(self.scene)
                }
            results |= {"uncertainty": self.uncertainty.to_json()} if self.uncertainty else {}
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

    def _headline(self) -> str:
        found = format_charges(self.charges_pC) if self.status is Status.CONVERGED else self.reason
        return f"{self.status}, {self.unknowns} unknowns, {len(self.history)} meshes: {found}"

    def summary(self) -> Summary:
        return summarize_solution(self.to_json(), self.uncertainty)

    # What draws and writes is slow to import.
    def plot(
        self, quantity: str = "deflection", ax: Axes | None = None, reach_mm: float | None = None
    ) -> Figure:
        """Draw a map of the film with electrodes, charges and probes, on `ax` or a new figure.

        `quantity` is ``deflection``, ``stress`` (S11 + S22), ``charge density``, ``principal
        directions``, ``mesh``, ``error`` (elements' shares in errors of charges) or ``contact``
        (pressure of tips); ValueError for another, or none in this scene. `reach_mm` is half the
        width of the map, by default the whole film. Fields of both signs are white at zero.
        """
        from pvdf_fem.view.film_map import draw_film_map

        return draw_film_map(self.film_data(), quantity, ax, reach_mm)

    def view(
        self,
        quantity: str = "deflection",
        scale: float | None = None,
        html: str | Path | None = None,
    ) -> Plotter:
        """The deflected film in 3-D, coloured by a field of `plot`; ``pip install pvdf-fem[view]``.

        `scale` multiplies the displacements; by default the film is then a quarter of its radius
        deep. `html` is where a page is written that any browser shows without a server. ``show()``
        of what is returned opens a window, or shows the film in a notebook. `ImportError` says what
        to install where nothing can be rendered.
        """
        from pvdf_fem.view.film_view import make_film_view

        return make_film_view(self.film_data(), quantity, scale, html)

    def to_dataframe(self) -> DataFrame:
        """Charges in pC and, with ``[readout]``, readings in V, by electrode."""
        from pandas import DataFrame

        names = [*CHARGES, *(["readings_V"] if self.scene.readout else [])]
        return DataFrame({name: getattr(self, name) for name in names}).rename_axis("electrode")

    def to_vtu(self, path: str | Path) -> None:
        """Write displacement, stresses, patches, charges and the scene to a VTU file."""
        from pvdf_fem.view.export import write_vtu

        write_vtu(self.film_data(), coerce("path", path, Path))

    def film_data(self) -> FilmData:
        """Fields and charges for `plot`, `view` and `to_vtu`."""
        from pvdf_fem.solver.next_order import compute_error_shares  # it imports the solvers

        fields, charges = self.discrete, (self.charges_pC, self.charge_errors_pC)
        shares = partial(compute_error_shares, fields, self.problem.outputs)
        film = fields.equilibrium, fields.state, self.unknowns
        return FilmData(*film, *charges, self.contacts, self.included, shares)


def _known(values: dict[str, float]) -> dict[str, float] | None:
    return None if any(map(math.isnan, values.values())) else values
