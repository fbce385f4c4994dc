"""Full solves in place of a response: one or two probes, with tangential forces or temperatures.

No charges are tabulated: each evaluation solves the scene, and the derivatives of the charges come
from adjoint solves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.inverse.touch.location_problem import LONGEST_STEPS, POSITION, get_base_quantity
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
from pvdf_fem.surrogate.touch_domain import (
    TOUCH_QUANTITIES,
    Domain,
    TouchColumn,
    compute_clear_reach_mm,
    resolve_response_settings,
)

UNSOLVED_PC = 1e15  #: Charges of a scene that cannot be solved.
#: Further quantities of a probe, with the endings of their keys.
FURTHER_QUANTITIES = {"tangential_N": ("[0]", "[1]"), "temperature_K": ("",)}


@dataclass(frozen=True, eq=False)
class SolvedResponse:
    """A `ChargeFunction` of one or two probes at once that solves the scene for each touch."""

    scene: Scene  #: The scene with a list of probes.
    quantity_names: tuple[str, ...]  #: Names of the quantities of all probes, (k,).
    free: tuple[str, ...]  #: Quantities that are free: charges have derivatives by these alone.
    domain: Domain
    error_bound: float  #: Tolerance of the solves.
    before_solve: Callable[[], None]  #: Called before each solve.
    is_fast: ClassVar[bool] = False
    unloaded_charges_pC: ClassVar[None] = None

    @classmethod
    def from_scene(
        cls,
        scene: Scene,
        touches: int,
        unknown: Sequence[str],
        tolerance: float,
        before_solve: Callable[[], None] = lambda: None,
    ) -> SolvedResponse:
        """Make the response of a scene's probes, or of its only probe twice.

        Its domain has the reach and the forces of the scene's ``[model]``, with probes that are
        entirely on the film.

        Parameters
        ----------
        scene : Scene
            The scene with one probe or a list of probes.
        touches : int
            Number of probes, 1 or 2.
        unknown : sequence of str
            Base names of the free quantities of every probe, of `LONGEST_STEPS`.
        tolerance : float
            Tolerance of the solves.
        before_solve : callable
            Called before each solve.

        Raises
        ------
        ValueError
            With a line for each mistake.
        """
        errors = list(_find_errors(scene, touches, unknown))
        if errors:
            raise ValueError("\n".join(errors))
        listed = _list_probes(scene, touches, unknown)
        quantities = _name_quantities(touches, unknown)
        periods_deg = [load.probe.period_deg for load in listed.loaded_probes]
        free = []
        for name in quantities:
            base = get_base_quantity(name)
            is_disc_rotation = base == "rotation_deg" and not periods_deg[_get_probe_index(name)]
            if base in unknown and not is_disc_rotation:
                free.append(name)
        without_derivative = {_make_key(name) for name in free} - set(
            list_parameters(Problem.from_scene(listed))
        )
        if without_derivative:
            keys = ", ".join(sorted(without_derivative))
            raise ValueError(f"unknown: charges have no derivative by {keys}; leave it out")
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
        """Names of the electrodes."""
        return tuple(electrode.name for electrode in self.scene.electrode_list)

    @property
    def scene_touch(self) -> Array:
        """Quantities of the scene's probes in the frame of its stage, (k,)."""
        touch = np.array([get_number(self.scene, _make_key(name)) for name in self.quantity_names])
        stage = self.scene.stage or Stage()
        width = len(TOUCH_QUANTITIES)
        for probe in range(count_probes(self)):
            values = touch[width * probe : width * (probe + 1)]  # a view
            place_mm, rotation_deg = stage.to_stage(values[POSITION], values[TouchColumn.ROTATION])
            values[POSITION] = place_mm
            values[TouchColumn.ROTATION] = rotation_deg
        return touch

    @property
    def swapped_columns(self) -> Indices:
        """Column of each quantity for the other one of two equal probes; empty for other probes."""
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
        """Solve the scene for each touch.

        Parameters
        ----------
        touches : ndarray, shape (n, k)
            Quantities on the film.

        Returns
        -------
        charges : ndarray, shape (n, electrodes)
            Charges in pC; `UNSOLVED_PC` where there is no solution.
        derivatives : ndarray, shape (n, electrodes, k)
            Derivatives by the free quantities; zero by others and where there is no solution.
        """
        charges = np.full((len(touches), len(self.names)), UNSOLVED_PC)
        derivatives = np.zeros((*charges.shape, touches.shape[1]))
        keys = [_make_key(name) for name in self.free]
        for index, touch in enumerate(touches):
            self.before_solve()
            try:
                scene = self._make_scene(touch)
                solution = solve_outputs(Problem.from_scene(scene))
                rates = compute_charge_rates(solution, keys)
            except (SceneError, NotConvergedError):
                continue
            derivatives[index][:, self.unknown] = 1e12 * rates.T
            charges[index] = list(solution.charges_pC.values())
        return charges, derivatives

    def _make_scene(self, touch: Array) -> Scene:
        """Return the scene with the quantities of a touch (k,)."""
        changes: dict[str, Any] = {"numerics.tolerance": self.error_bound}
        for name, value in zip(self.quantity_names, touch.tolist(), strict=True):
            changes[_make_key(name)] = value
        return self.scene.with_(**changes)


def make_single_probe_scene(scene: Scene, probe_index: int) -> Scene:
    """Return the scene with one of its probes alone, on the centre, under 1 N and cold."""
    loaded = scene.loaded_probes[probe_index]
    centred = dict.fromkeys(("x_mm", "y_mm", "rotation_deg"), 0.0)
    unset = dict.fromkeys((*ListedProbe.list_load_keys(), *HEAT_KEYS))
    probe = loaded.probe.model_copy(update=centred | unset)
    load = loaded.load.model_copy(update={"force_N": 1.0, "tangential_N": None})
    numerics = Numerics(tolerance=1e-2, observable=scene.numerics.observable)
    return scene.with_(probe=probe, load=load, numerics=numerics, readout=None)


def _name_quantities(touches: int, unknown: Sequence[str]) -> tuple[str, ...]:
    """Name the quantities of all probes: four of each probe, then further ones if unknown."""
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
    """Choose the domain of places and forces for a scene with a list of probes."""
    domains = []
    for index in range(touches):
        single = make_single_probe_scene(scene, index)
        domains.append(resolve_response_settings(single).domain)
    reaches_mm = [domain.reach_mm for domain in domains]
    reach_mm = min(compute_clear_reach_mm(scene), *reaches_mm)
    return Domain(reach_mm, domains[0].force_N)


def _list_probes(scene: Scene, touches: int, unknown: Sequence[str]) -> Scene:
    """Return the scene with a list of probes, each with a force of its own.

    Parameters
    ----------
    scene : Scene
        A scene with as many probes as touches, or with one, which is then taken twice, at two
        places apart.
    touches : int
        Number of probes.
    unknown : sequence of str
        Free quantities. An unknown temperature begins with a cold probe, an unknown tangential
        force with zero.
    """
    given = scene.loaded_probes
    probes = list(given) * (touches // len(given))
    tables = []
    for loaded in probes:
        table = {**to_plain_value(loaded.probe), "force_N": loaded.load.force_N}
        if "temperature_K" in unknown:
            table["temperature_K"] = 0.0
        if "tangential_N" in unknown or loaded.load.tangential_N:
            table["tangential_N"] = loaded.load.tangential_N or (0.0, 0.0)
        tables.append(table)
    if len(probes) > len(given):
        offset_mm = min(0.5e3 * probes[0].outline.perimeter, 0.5 * scene.film.radius_mm)
        for table, x_mm in zip(tables, (-offset_mm, offset_mm), strict=True):
            table |= {"x_mm": x_mm, "y_mm": 0.0}
    return scene.with_(probe=tables)


def _find_errors(scene: Scene, touches: int, unknown: Sequence[str]) -> Iterator[str]:
    """Find the reasons why a scene's touches cannot be located by solves.

    Parameters
    ----------
    scene : Scene
        The scene.
    touches : int
        Number of probes that touch at once.
    unknown : sequence of str
        Base names of the free quantities.

    Yields
    ------
    str
        One line for each reason, which begins with a key or an argument.
    """
    probes = scene.loaded_probes
    if touches not in (1, 2):
        yield f"touches = {touches}: must be 1 or 2"
    elif len(probes) not in (1, touches):
        yield f"probe: the scene has {len(probes)} probes; give {touches}, or one for both touches"
    elif touches > len(probes) and not {"x_mm", "y_mm"} <= set(unknown):
        advice = "add x_mm and y_mm, or list two probes as [[probe]]"
        yield f"unknown: the places of two touches of one probe must be unknown; {advice}"
    if any(loaded.load.depth_mm is not None for loaded in probes):
        yield "load.depth_mm: cannot be combined with unknown forces; give load.force_N instead"
    if "temperature_K" in unknown:
        if scene.film.pyroelectric_uC_m2K is None:
            yield "film.pyroelectric_uC_m2K: is required to find temperature_K; add it"
        if any(loaded.probe.contact_time_s is None for loaded in probes):
            yield "probe.contact_time_s: is required to find temperature_K; add it"
    for name in unknown:
        if name not in LONGEST_STEPS:
            yield f"{name}: not a quantity of a touch; choose from {', '.join(LONGEST_STEPS)}"
    if not unknown:
        yield f"unknown: must not be empty; choose from {', '.join(LONGEST_STEPS)}"


def _make_key(quantity: str) -> str:
    """Return the scene's key of a quantity."""
    return quantity if quantity.startswith("probe[") else f"probe[0].{quantity}"


def _get_probe_index(quantity: str) -> int:
    """Return the index of the probe in a quantity's name, 0 for the only probe."""
    return int(parse_key(quantity)[1]) if quantity.startswith("probe[") else 0
