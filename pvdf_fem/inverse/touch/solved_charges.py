"""Full solves as a model of the charges: one or two probes, with tangential forces or temperatures.

No table of the charges is built: each evaluation solves the scene, and its slopes are the adjoint
derivatives.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.inverse.touch.location_problem import LONGEST_STEPS, get_base_quantity
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.changes import get_number, parse_key, to_plain_value
from pvdf_fem.scene.outlines.shape import HEAT_KEYS
from pvdf_fem.scene.scene import Numerics, Scene, SceneError
from pvdf_fem.scene.shapes import Pressing
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


@dataclass(frozen=True, eq=False)
class SolvedResponse:
    """Charges of one or two probes at once by full solves."""

    scene: Scene  #: With a list of probes.
    quantities: tuple[str, ...]
    sought: tuple[str, ...]  #: Of the quantities: only by these there are slopes.
    domain: Domain
    error_bound: float  #: Tolerance of the solves.
    count: Callable[[], None]  #: Called before each solve.
    is_fast: ClassVar[bool] = False
    unloaded_charges_pC: ClassVar[None] = None

    @classmethod
    def from_scene(
        cls,
        scene: Scene,
        touches: int,
        unknown: Sequence[str],
        tolerance: float,
        count: Callable[[], None] = lambda: None,
    ) -> SolvedResponse:
        """The model of a scene's probes, or of its one probe twice, over the reach and the forces
        of the scene's ``[model]``, with probes on the film. Raises `ValueError` with a line for
        each mistake."""
        if mistakes := [*_mistakes(scene, touches, unknown)]:
            raise ValueError("\n".join(mistakes))
        listed = _listed(scene, touches, unknown)
        probes = [f"probe[{i}]." if touches > 1 else "" for i in range(touches)]
        names = [probe + name for probe in probes for name in TOUCH_QUANTITIES]
        for name, ends in (("tangential_N", ("[0]", "[1]")), ("temperature_K", ("",))):
            if name in unknown:
                names += [probe + name + end for probe in probes for end in ends]
        wanted = [
            resolve_response_settings(make_single_probe_scene(listed, i))[0] for i in range(touches)
        ]
        reach_mm = min(compute_clear_reach_mm(listed), *(domain.reach_mm for domain in wanted))
        domain = Domain(reach_mm, wanted[0].force_N)
        periods = [touch.probe.period_deg for touch in listed.loaded_probes]
        sought = tuple(
            name
            for name in names
            if get_base_quantity(name) in unknown
            # a disc does not turn
            and (get_base_quantity(name) != "rotation_deg" or periods[_probe(name)])
        )
        made = cls(listed, tuple(names), sought, domain, tolerance, count)
        if wrong := {made.key(name) for name in sought} - set(
            list_parameters(Problem.from_scene(listed))
        ):
            raise ValueError(f"unknown: charges have no derivative by {', '.join(sorted(wrong))}")
        return made

    @property
    def unknown(self) -> Indices:
        """Which of the quantities are sought."""
        return np.array([i for i, name in enumerate(self.quantities) if name in self.sought])

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the electrodes."""
        return tuple(electrode.name for electrode in self.scene.electrode_list)

    @staticmethod
    def key(name: str) -> str:
        """The key of the scene that holds a quantity."""
        return name if name.startswith("probe[") else f"probe[0].{name}"

    @property
    def touch(self) -> Array:
        """The scene's touch (k,) in the frame of its stage."""
        touch = np.array([get_number(self.scene, self.key(name)) for name in self.quantities])
        stage = self.scene.stage or Stage()
        for x in range(0, len(TOUCH_QUANTITIES) * count_probes(self), len(TOUCH_QUANTITIES)):
            place, turned = stage.to_stage(
                touch[x : x + TouchColumn.ROTATION], touch[x + TouchColumn.ROTATION]
            )
            touch[x : x + TouchColumn.FORCE] = [*place, turned]
        return touch

    @property
    def other_probe(self) -> Indices:
        """Index of each quantity at the other probe of two equal probes; empty for other probes."""
        if count_probes(self) < 2 or make_single_probe_scene(
            self.scene, 0
        ) != make_single_probe_scene(self.scene, 1):
            return np.array([], dtype=int)
        swapped = [f"probe[{1 - _probe(n)}]{n[len('probe[0]') :]}" for n in self.quantities]
        return np.array([self.quantities.index(name) for name in swapped])

    def scene_of(self, touch: Array) -> Scene:
        """The scene with a touch (k,)."""
        changes = dict(zip(map(self.key, self.quantities), touch.tolist(), strict=True))
        return self.scene.with_(**changes, **{"numerics.tolerance": self.error_bound})

    def evaluate(self, touches: Array) -> tuple[Array, Array]:
        """Charges (n, electrodes) and slopes (n, electrodes, k); `UNSOLVED_PC` without slopes where
        there is no solution."""
        charges = np.full((len(touches), len(self.names)), UNSOLVED_PC)
        slopes = np.zeros((*charges.shape, touches.shape[1]))
        keys = [*map(self.key, self.sought)]
        for i, touch in enumerate(touches):
            self.count()
            try:
                solution = solve_outputs(Problem.from_scene(self.scene_of(touch)))
                slopes[i][:, self.unknown] = 1e12 * compute_charge_rates(solution, keys).T
                charges[i] = [*solution.charges_pC.values()]
            except (SceneError, NotConvergedError):
                continue
        return charges, slopes


def make_single_probe_scene(scene: Scene, number: int) -> Scene:
    """One of a scene's probes on the centre, under 1 N and cold."""
    touch = scene.loaded_probes[number]
    place = dict.fromkeys(("x_mm", "y_mm", "rotation_deg"), 0.0)
    unsaid = dict.fromkeys((*Pressing.model_fields, *HEAT_KEYS))
    probe = touch.probe.model_copy(update=place | unsaid)
    load = touch.load.model_copy(update={"force_N": 1.0, "tangential_N": None})
    numerics = Numerics(tolerance=1e-2, observable=scene.numerics.observable)
    return scene.with_(probe=probe, load=load, numerics=numerics, readout=None)


def _listed(scene: Scene, touches: int, unknown: Sequence[str]) -> Scene:
    """The scene with a list of probes, each with a force of its own, apart where one is two, and
    cold where its temperature is sought."""
    probes = [*scene.loaded_probes] * (touches // len(scene.loaded_probes))
    tables = [{**to_plain_value(touch.probe), "force_N": touch.load.force_N} for touch in probes]
    for touch, table in zip(probes, tables, strict=True):
        if "temperature_K" in unknown:
            table["temperature_K"] = 0.0
        if "tangential_N" in unknown or touch.load.tangential_N:
            table["tangential_N"] = touch.load.tangential_N or (0.0, 0.0)
    if len(probes) > len(scene.loaded_probes):
        apart_mm = min(0.5e3 * probes[0].outline.perimeter, 0.5 * scene.film.radius_mm)
        for table, x_mm in zip(tables, (-apart_mm, apart_mm), strict=True):
            table |= {"x_mm": x_mm, "y_mm": 0.0}
    return scene.with_(probe=tables)


def _mistakes(scene: Scene, touches: int, unknown: Sequence[str]) -> Iterator[str]:
    """What keeps a scene from being searched, by key."""
    if touches not in (1, 2):
        yield f"touches = {touches}: give 1 or 2"
    elif len(scene.loaded_probes) not in (1, touches):
        yield f"probe: the scene has {len(scene.loaded_probes)}; give {touches}, or one for both"
    elif touches > len(scene.loaded_probes) and not {"x_mm", "y_mm"} <= set(unknown):
        yield "unknown: both touches of one probe need x_mm and y_mm; add them, or give [[probe]]"
    if any(touch.load.depth_mm is not None for touch in scene.loaded_probes):
        yield "load.depth_mm: forces are sought here; give load.force_N"
    if "temperature_K" in unknown:
        if scene.film.pyroelectric_uC_m2K is None:
            yield "film.pyroelectric_uC_m2K: not given; it tells temperature_K, so give it"
        if any(touch.probe.contact_time_s is None for touch in scene.loaded_probes):
            yield "probe.contact_time_s: not given; heat spreads meanwhile, so give it"
    for name in unknown:
        if name not in LONGEST_STEPS:
            yield f"{name}: no quantity of a touch; choose from {', '.join(LONGEST_STEPS)}"
    if not unknown:
        yield f"unknown: nothing is sought; choose from {', '.join(LONGEST_STEPS)}"


def _probe(name: str) -> int:
    """Index of the probe in a quantity's name."""
    return int(parse_key(name)[1]) if name.startswith("probe[") else 0
