"""A response that solves the scene: for one or two probes, tangential forces and temperatures.

No charges are tabulated: each evaluation solves the scene, and adjoint solves give the derivatives
of the charges.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.inverse.coordinates import LONGEST_STEPS, get_base_quantity
from pvdf_fem.inverse.touch.location_problem import POSITION
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.changes import get_number, parse_key, to_plain_value
from pvdf_fem.scene.placed.probe import HEAT_KEYS, ListedProbe
from pvdf_fem.scene.scene import Numerics, Scene, SceneError
from pvdf_fem.scene.stage import Stage
from pvdf_fem.solver.adaptive import solve_outputs
from pvdf_fem.solver.nonlinear.status import NotConvergedError
from pvdf_fem.solver.sensitivity.parameters import list_parameters
from pvdf_fem.solver.sensitivity.rates import compute_charge_rates
from pvdf_fem.surrogate.charge_function import count_probes
from pvdf_fem.surrogate.charge_sensitivity import (
    differentiate_charges,
    list_film_keys,
    require_derivatives,
    solve_unloaded_film,
)
from pvdf_fem.surrogate.touch_domain import (
    TOUCH_QUANTITIES,
    Domain,
    TouchColumn,
    compute_clear_reach_mm,
    resolve_response_settings,
)

#: Charge that stands for a scene without a solution. It is so large that a search rejects the step.
UNSOLVED_PC = 1e15
#: Further quantities of a probe, with the endings of the keys of their components.
FURTHER_QUANTITIES = {"tangential_N": ("[0]", "[1]"), "temperature_K": ("",)}


@dataclass(frozen=True, eq=False)
class SolvedResponse:
    """A `ChargeFunction` for one or two probes at once that solves the scene for each touch."""

    scene: Scene  #: The scene with a list of probes.
    quantity_names: tuple[str, ...]  #: Names of the k quantities of all probes.
    #: Names of the free quantities. `evaluate` computes derivatives with respect to these alone.
    free: tuple[str, ...]
    domain: Domain  #: Maximum distance of the probes from the centre, and range of forces.
    error_bound: float  #: Tolerance of the solves.
    before_solve: Callable[[], None]  #: Called without arguments before each solve.
    is_fast: ClassVar[bool] = False  #: Evaluations are too slow for sampling a posterior.
    unloaded_charges_pC: ClassVar[None] = None  #: Unloaded charges are not stored.

    @classmethod
    def from_scene(
        cls,
        scene: Scene,
        touches: int,
        unknown: Sequence[str],
        tolerance: float,
        before_solve: Callable[[], None] = lambda: None,
    ) -> SolvedResponse:
        """Make the response of a scene's probes, or of its only probe at two positions.

        The domain has the reach (the maximum distance from the centre) and the forces of the
        scene's ``[model]``. The reach is reduced if a probe would otherwise extend beyond the film.

        Parameters
        ----------
        scene : Scene
            The scene with one probe or a list of probes.
        touches : int
            Number of simultaneous touches, 1 or 2.
        unknown : sequence of str
            Names of the free quantities of every probe, without indices: keys of `LONGEST_STEPS`.
            The rotation of a disc is fixed all the same.
        tolerance : float
            Relative tolerance of the charges of the solves.
        before_solve : callable
            Called without arguments before each solve. Default: does nothing.

        Raises
        ------
        ValueError
            If touches or unknowns are incompatible with the scene, with a line for each mistake; or
            if the charges have no derivative with respect to an unknown.
        """
        errors = list(_find_scene_suitability_errors(scene, touches, unknown))
        if errors:
            raise ValueError("\n".join(errors))
        listed = _make_probe_list_scene(scene, touches, unknown)
        quantities = _list_quantity_names(touches, unknown)
        periods_deg = [load.probe.period_deg for load in listed.loaded_probes]
        free = []
        for name in quantities:
            base = get_base_quantity(name)
            is_disc_rotation = base == "rotation_deg" and not periods_deg[_get_probe_index(name)]
            if base in unknown and not is_disc_rotation:
                free.append(name)
        differentiable = set(list_parameters(Problem.from_scene(listed)))
        without_derivative = {_make_quantity_key(name) for name in free} - differentiable
        if without_derivative:
            keys = ", ".join(sorted(without_derivative))
            reason = f"charges have no derivative with respect to {keys}"
            raise ValueError(f"unknown: {reason}; leave it out")
        return cls(
            scene=listed,
            quantity_names=quantities,
            free=tuple(free),
            domain=_choose_domain(listed, touches),
            error_bound=tolerance,
            before_solve=before_solve,
        )

    @property
    def unknown(self) -> Indices:
        """Columns of the free quantities."""
        return np.array([i for i, name in enumerate(self.quantity_names) if name in self.free])

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the electrodes, in the order of the charges."""
        return tuple(electrode.name for electrode in self.scene.electrode_list)

    @property
    def scene_touch(self) -> Array:
        """Quantities of the scene's probes as a touch in the frame of its stage; shape (k,)."""
        touch = np.array(
            [get_number(self.scene, _make_quantity_key(name)) for name in self.quantity_names]
        )
        stage = self.scene.stage or Stage()
        width = len(TOUCH_QUANTITIES)
        for probe in range(count_probes(self)):
            values = touch[width * probe : width * (probe + 1)]  # a view of touch
            position_mm, rotation_deg = stage.to_stage(
                values[POSITION], values[TouchColumn.ROTATION]
            )
            values[POSITION] = position_mm
            values[TouchColumn.ROTATION] = rotation_deg
        return touch

    @property
    def swapped_columns(self) -> Indices:
        """Column order that exchanges the quantities of two equal probes.

        ``touch[swapped_columns]`` has the same charges as ``touch``. The array is empty if there is
        only one probe or if the two probes differ.
        """
        if count_probes(self) < 2:
            return np.array([], dtype=int)
        first = make_single_probe_scene(self.scene, 0)
        if first != make_single_probe_scene(self.scene, 1):
            return np.array([], dtype=int)
        columns = []
        for name in self.quantity_names:
            probe = _get_probe_index(name)
            swapped = name.replace(f"probe[{probe}]", f"probe[{1 - probe}]", 1)
            columns.append(self.quantity_names.index(swapped))
        return np.array(columns)

    def evaluate(self, touches: Array) -> tuple[Array, Array]:
        """Solve the scene for each touch, and compute the charges and their derivatives.

        Parameters
        ----------
        touches : ndarray, shape (n, k)
            Quantities of each touch in the frame of the film, with forces in N and not as
            logarithms.

        Returns
        -------
        charges : ndarray, shape (n, electrodes)
            Charges in pC; `UNSOLVED_PC` for a touch whose scene is invalid or has no solution.
        derivatives : ndarray, shape (n, electrodes, k)
            Derivatives of the charges with respect to the touch; zero with respect to fixed
            quantities, and for a touch whose scene is invalid or has no solution.
        """
        charges = np.full((len(touches), len(self.names)), UNSOLVED_PC)
        derivatives = np.zeros((*charges.shape, touches.shape[1]))
        keys = [_make_quantity_key(name) for name in self.free]
        for index, touch in enumerate(touches):
            self.before_solve()
            try:
                scene = self.make_scene(touch)
                solution = solve_outputs(Problem.from_scene(scene))
                rates = compute_charge_rates(solution, keys)
            except (SceneError, NotConvergedError):
                continue
            derivatives[index][:, self.unknown] = 1e12 * rates.T
            charges[index] = list(solution.charges_pC.values())
        return charges, derivatives

    @cached_property
    def sensitivities(self) -> SolvedSensitivities:
        """Derivatives of the charges with respect to the film's keys in ``[calibration]``."""
        return SolvedSensitivities(self, list_film_keys(self.scene))

    def make_scene(self, touch: Array) -> Scene:
        """Return the scene with the quantities of a touch of shape (k,), and with `error_bound`."""
        changes: dict[str, Any] = {"numerics.tolerance": self.error_bound}
        for name, value in zip(self.quantity_names, touch.tolist(), strict=True):
            changes[_make_quantity_key(name)] = value
        return self.scene.with_(**changes)


@dataclass(frozen=True, eq=False)
class SolvedSensitivities:
    """Derivatives of charges with respect to parameters of the film, by a solve of each touch."""

    response: SolvedResponse
    keys: tuple[str, ...]  #: Keys of the parameters in the scene.

    def select(self, keys: Sequence[str]) -> SolvedSensitivities:
        """Return the derivatives with respect to some of the keys, in their order.

        A `ValueError` is raised if charges have no derivative with respect to a key.
        """
        require_derivatives(self.response.scene, keys)
        return replace(self, keys=tuple(keys))

    @cached_property
    def unloaded_slopes(self) -> Array:
        """Derivatives of the charges of the unloaded film, shape (electrodes, keys)."""
        return solve_unloaded_film(self.response.scene, self.keys)[:, 1:]

    def evaluate(self, touches: Array, charges_pC: Array, slopes: Array) -> Array:
        """Solve the derivatives of the changes of the charges.

        Parameters and result are those of `ChargeSensitivities.evaluate`; only the touches are
        used. The derivatives are zero for a touch whose scene is invalid or has no solution.
        """
        derivatives = np.zeros((*charges_pC.shape, len(self.keys)))
        for index, touch in enumerate(touches):
            self.response.before_solve()
            try:
                scene = self.response.make_scene(touch)
                solution = solve_outputs(Problem.from_scene(scene))
                total = differentiate_charges(solution, self.keys)
            except (SceneError, NotConvergedError):
                continue
            derivatives[index] = total - self.unloaded_slopes
        return derivatives


def make_single_probe_scene(scene: Scene, probe_index: int) -> Scene:
    """Return the scene with only one of its probes, at the centre and pressed with 1 N.

    The probe has neither a rotation nor a tangential force nor a temperature.

    Parameters
    ----------
    scene : Scene
        The scene with one or several probes.
    probe_index : int
        Index of this probe in the scene.

    Returns
    -------
    Scene
        A scene without a readout. Its numerics are the defaults, except for a coarse tolerance and
        for the `observable` of the given scene.
    """
    loaded = scene.loaded_probes[probe_index]
    centred = dict.fromkeys(("x_mm", "y_mm", "rotation_deg"), 0.0)
    unset = dict.fromkeys((*ListedProbe.list_load_keys(), *HEAT_KEYS))
    probe = loaded.probe.model_copy(update=centred | unset)
    load = loaded.load.model_copy(update={"force_N": 1.0, "tangential_N": None})
    numerics = Numerics(tolerance=1e-2, observable=scene.numerics.observable)
    return scene.with_(probe=probe, load=load, numerics=numerics, readout=None)


def _list_quantity_names(touches: int, unknown: Sequence[str]) -> tuple[str, ...]:
    """List the names of the quantities: `TOUCH_QUANTITIES` of each probe, then further unknowns."""
    prefixes = [""] if touches == 1 else [f"probe[{index}]." for index in range(touches)]
    names = []
    for prefix in prefixes:
        names += [prefix + name for name in TOUCH_QUANTITIES]
    for name, endings in FURTHER_QUANTITIES.items():
        if name in unknown:
            for prefix in prefixes:
                names += [prefix + name + ending for ending in endings]
    return tuple(names)


def _choose_domain(scene: Scene, touches: int) -> Domain:
    """Choose the domain that is common to all probes of a scene with a list of probes.

    The reach is the smallest one of all probes, and the range of forces is that of the first probe.
    """
    domains = []
    for index in range(touches):
        single = make_single_probe_scene(scene, index)
        domains.append(resolve_response_settings(single).domain)
    reaches_mm = [domain.reach_mm for domain in domains]
    reach_mm = min(compute_clear_reach_mm(scene), *reaches_mm)
    return Domain(reach_mm, domains[0].force_N)


def _make_probe_list_scene(scene: Scene, touches: int, unknown: Sequence[str]) -> Scene:
    """Return the scene with a list of probes, one for each touch, each with its own force.

    Parameters
    ----------
    scene : Scene
        A scene with as many probes as touches, or with one probe. For two touches the one probe is
        listed twice, at two positions apart from each other.
    touches : int
        Number of probes in the list.
    unknown : sequence of str
        Names of the free quantities without indices. An unknown temperature is set to 0, and an
        unknown tangential force to 0 unless the scene has one.

    Returns
    -------
    Scene
        A scene with `touches` probes.
    """
    scene_probes = scene.loaded_probes
    probes = list(scene_probes) * (touches // len(scene_probes))
    tables = []
    for loaded in probes:
        table = {**to_plain_value(loaded.probe), "force_N": loaded.load.force_N}
        if "temperature_K" in unknown:
            table["temperature_K"] = 0.0
        if "tangential_N" in unknown or loaded.load.tangential_N:
            table["tangential_N"] = loaded.load.tangential_N or (0.0, 0.0)
        tables.append(table)
    if len(probes) > len(scene_probes):
        offset_mm = min(0.5e3 * probes[0].outline.perimeter, 500.0 * scene.film.radius)
        for table, x_mm in zip(tables, (-offset_mm, offset_mm), strict=True):
            table |= {"x_mm": x_mm, "y_mm": 0.0}
    return scene.with_(probe=tables)


def _find_scene_suitability_errors(
    scene: Scene, touches: int, unknown: Sequence[str]
) -> Iterator[str]:
    """Yield an error message for each reason why touches cannot be located by solves of a scene.

    Parameters
    ----------
    scene : Scene
        The scene with its probes and loads.
    touches : int
        Number of simultaneous touches.
    unknown : sequence of str
        Names of the free quantities without indices.

    Yields
    ------
    str
        One line for each reason. It begins with the key or argument to change.
    """
    probes = scene.loaded_probes
    if touches not in (1, 2):
        yield f"touches = {touches}: must be 1 or 2"
    elif len(probes) not in (1, touches):
        yield f"probe: the scene has {len(probes)} probes; give {touches}, or one for both touches"
    elif touches > len(probes) and not {"x_mm", "y_mm"} <= set(unknown):
        advice = "add x_mm and y_mm, or list two probes as [[probe]]"
        yield f"unknown: the positions of two touches of one probe must be unknown; {advice}"
    if any(loaded.load.depth_mm is not None for loaded in probes):
        yield "load.depth_mm: cannot be combined with unknown forces; give load.force_N instead"
    if "temperature_K" in unknown:
        if scene.film.pyroelectric_uC_m2K is None:
            yield "film.pyroelectric_uC_m2K: is required to find temperature_K; add it"
        if any(loaded.probe.contact_time_s is None for loaded in probes):
            yield "probe.contact_time_s: is required to find temperature_K; add it"
    for name in unknown:
        if name not in LONGEST_STEPS:
            yield f"{name}: is not a quantity of a touch; choose from {', '.join(LONGEST_STEPS)}"
    if not unknown:
        yield f"unknown: must not be empty; choose from {', '.join(LONGEST_STEPS)}"


def _make_quantity_key(quantity: str) -> str:
    """Return the key of a quantity in a scene with a list of probes."""
    return quantity if quantity.startswith("probe[") else f"probe[0].{quantity}"


def _get_probe_index(quantity: str) -> int:
    """Return the index of the probe in a quantity's name; 0 if the name has no index."""
    return int(parse_key(quantity)[1]) if quantity.startswith("probe[") else 0
