"""Full solves as a model of the charges: one or two probes, with tangential forces or temperatures.

No table of the charges is built: each evaluation solves the scene, and its slopes are the adjoint
derivatives. Searches start where charges of single touches, added up, are most like the measured
ones.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.charges.goals import goals_of
from pvdf_fem.derivatives.parameters import parameters_of
from pvdf_fem.derivatives.rates import charge_rates
from pvdf_fem.progress import Counted, Progress, shown, silent
from pvdf_fem.response.model import FORCE, QUANTITIES, ROTATION, Domain, probes_of, room_mm
from pvdf_fem.scene.change import number_at, plain, steps_of
from pvdf_fem.scene.scene import Scene, SceneError
from pvdf_fem.scene.stage import Stage
from pvdf_fem.solution.solve import solve_goals
from pvdf_fem.solvers.status import NotConvergedError
from pvdf_fem.touch.least_squares import Descent, SearchOptions, descend, joined
from pvdf_fem.touch.location import Location
from pvdf_fem.touch.measurement import Deviations, Measurement, charge_mistakes
from pvdf_fem.touch.problem import LONGEST_MORE, Problem, along_stage
from pvdf_fem.touch.search import DEFAULTS, distinct, location, weakest
from pvdf_fem.touch.superposed import SuperposedOptions, pressed_alone, superposed
from pvdf_fem.touch.touch import explains

SOUGHT = (*QUANTITIES, *LONGEST_MORE)  #: What may be sought.
REACH = 1.5  #: How far out touches are sought, over the distance of the farthest electrode.
FORCES_N = (1e-3, 1e3)  #: Forces that are sought.
UNSOLVED_PC = 1e15  #: Charges of a scene that cannot be solved.


@dataclass(frozen=True)
class SolveOptions:
    """How touches are searched for by solves."""

    #: Largest distance of a touch from the centre in mm; by default `REACH` times that of the
    #: farthest electrode.
    reach_mm: float | None = None
    #: Tolerance of coarse solves, and of the final ones, whose slopes give the deviations: to 1 %
    #: at 1e-4, to 6 % at 1e-3, measured where the probe's rim crosses an electrode.
    first_tolerance: float = 1e-2
    tolerance: float = 1e-4
    #: Where searches start. How many go on after some first steps; the others go on where these
    #: lead to no touch that explains the charges.
    begin: SuperposedOptions = field(default_factory=SuperposedOptions)
    first_steps: int = 3
    followed: int = 5
    #: Charges of which a larger chi-square is less probable than this are not explained.
    significance: float = 0.05
    #: Starts about the best end, in longest steps along what the charges determine least.
    valley: tuple[float, ...] = (-0.5, 0.5)
    #: How often that is done again where it led to a better end.
    rounds: int = 3
    #: Chi-square that a last step may gain, and its length over the longest.
    search: SearchOptions = field(
        default_factory=lambda: SearchOptions(40, arrived=0.02, short=0.04, relief=0.3)
    )


@dataclass(frozen=True, eq=False)
class Solves:
    """Charges of one or two probes at once by full solves."""

    scene: Scene  #: With a list of probes.
    quantities: tuple[str, ...]
    sought: tuple[str, ...]  #: Of the quantities: only by these there are slopes.
    domain: Domain
    error_bound: float  #: Tolerance of the solves.
    #: Called before each solve.
    count: Callable[[], None] = field(default_factory=lambda: Counted(silent, 0))
    cheap: ClassVar[bool] = False
    at_rest_pC: ClassVar[None] = None

    @classmethod
    def of(
        cls,
        scene: Scene,
        touches: int,
        unknown: Sequence[str],
        options: SolveOptions,
        progress: Progress = silent,
    ) -> Solves:
        """The model of a scene's probes, or of its one probe twice. Raises `ValueError` with a line
        for each mistake."""
        if mistakes := [*_mistakes(scene, touches, unknown)]:
            raise ValueError("\n".join(mistakes))
        listed, names = _listed(scene, touches, unknown), []
        for names_of_probe in (QUANTITIES, [name for name in LONGEST_MORE if name in unknown]):
            for i in range(touches):
                key = f"probe[{i}]." if touches > 1 else ""
                for name in names_of_probe:
                    ends = ("[0]", "[1]") if name == "tangential_N" else ("",)
                    names += [f"{key}{name}{end}" for end in ends]
        periods = [touch.probe.period_deg for touch in listed.loaded_probes]
        sought = []
        for name in names:
            quantity = _quantity(name)
            turns = quantity != "rotation_deg" or periods[_probe(name)] > 0.0  # of a disc none
            if quantity in unknown and turns:
                sought.append(name)
        model_names = tuple(names), tuple(sought)
        reach_mm = reach_by_electrodes_mm(scene) if options.reach_mm is None else options.reach_mm
        expected = options.begin.starts * (1 + options.first_steps) + 10 * options.followed
        made = cls(listed, *model_names, Domain(reach_mm, FORCES_N), options.tolerance)
        if wrong := {made.key(name) for name in sought} - set(parameters_of(listed)):
            raise ValueError(f"unknown: charges have no derivative by {', '.join(sorted(wrong))}")
        return replace(made, count=Counted(progress, expected))

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
        touch = np.array([number_at(self.scene, self.key(name)) for name in self.quantities])
        stage = self.scene.stage or Stage()
        for x in range(0, len(QUANTITIES) * probes_of(self), len(QUANTITIES)):
            place, turned = stage.to_stage(touch[x : x + ROTATION], touch[x + ROTATION])
            touch[x : x + FORCE] = [*place, turned]
        return touch

    def scene_of(self, touch: Array) -> Scene:
        """The scene with a touch (k,)."""
        changes = dict(zip(map(self.key, self.quantities), touch.tolist(), strict=True))
        return self.scene.with_(**changes, **{"numerics.tolerance": self.error_bound})

    def evaluate(self, touches: Array) -> tuple[Array, Array]:
        """Charges (n, electrodes) and slopes (n, electrodes, k); `UNSOLVED_PC` without slopes where
        there is no solution."""
        charges = np.full((len(touches), len(self.names)), UNSOLVED_PC)
        slopes = np.zeros((*charges.shape, touches.shape[1]))
        columns = [self.quantities.index(name) for name in self.sought]
        for i, touch in enumerate(touches):
            self.count()
            try:
                solution = solve_goals(scene := self.scene_of(touch), goals_of(scene))
                rates = 1e12 * charge_rates(solution, [*map(self.key, self.sought)])
            except (SceneError, NotConvergedError):
                continue
            charges[i] = [*solution.charges_pC.values()]
            slopes[i][:, columns] = rates.T
        return charges, slopes


def locate_by_solves(
    scene: Scene,
    charges_pC: Mapping[str, float],
    sigma: Deviations,
    noise_pC: Deviations | None,
    reading: str | None,
    touches: int,
    unknown: Sequence[str],
    options: SolveOptions,
    progress: Progress | bool | None = None,
) -> Location:
    """The touches that may have given some charges; see `pvdf_fem.touch.locate.locate`."""
    if mistakes := [*charge_mistakes(scene, charges_pC, sigma, noise_pC, reading)]:
        raise ValueError("\n".join(mistakes))
    with shown("solves", progress) as show:
        model = Solves.of(scene, touches, unknown, options, show)
        return _located(model, charges_pC, sigma, noise_pC, reading, options)


def _located(
    model: Solves,
    charges_pC: Mapping[str, float],
    sigma: Deviations,
    noise_pC: Deviations | None,
    reading: str | None,
    options: SolveOptions,
) -> Location:
    """The touches of a model."""
    if len(charges_pC) < len(model.sought):
        raise ValueError(
            f"charges: {len(charges_pC)} channels do not tell {len(model.sought)} unknown"
            f" quantities ({', '.join(model.sought)}); give more electrodes, or seek less"
        )
    measurement = Measurement.of(model, tuple(charges_pC), sigma, noise_pC, reading)
    sought = np.array([model.quantities.index(name) for name in model.sought])
    readings = np.array([list(charges_pC.values())], dtype=float)
    problem = measurement.problem(readings, np.sort(sought))
    ends = search_by_solves(problem, model, options)
    return replace(location(problem, ends), reading=measurement.reading)


def reach_by_electrodes_mm(scene: Scene) -> float:
    """Where touches are sought, by the farthest electrode, and with their probes on the film."""
    farthest_mm = max(1e3 * float(np.hypot(*e.outline.centroid)) for e in scene.electrode_list)
    return min(REACH * farthest_mm, room_mm(scene))


def search_by_solves(problem: Problem, model: Solves, options: SolveOptions) -> Descent:
    """Distinct ends of searches for the touch of a problem by its model: coarse ones from the most
    likely starts, then about the best end, then the final ones."""
    rough = replace(model, error_bound=options.first_tolerance)
    spread = np.hypot(problem.deviations_pC, options.first_tolerance / 3**0.5 * problem.charges_pC)
    coarse = replace(problem, model=along_stage(rough), deviations_pC=spread)
    begun = [_begun(cold, rough, options) for cold in _cold(coarse)]
    freedom, found = len(problem.electrodes) - len(problem.unknown), []
    for part in (slice(options.followed), slice(options.followed, None)):
        starts = np.concatenate([likely[part] for likely in begun])
        ends = ordered(coarse, descend(coarse, starts, options=options.search))
        for _ in range(options.rounds if ends.at.size else 0):
            least = ends.chi_square[0]
            steps = np.array(options.valley)[:, None] * weakest(coarse, ends)
            more = descend(coarse, ends.at[0] + steps, options=options.search)
            ends = ordered(coarse, joined([ends, more]))
            if ends.chi_square[0] > least - options.search.arrived:
                break
        if ends.at.size:
            found.append(descend(problem, ends.at, options=options.search))
        if found and explains(found[-1].ranking.min()[None], freedom, options.significance).any():
            break
    return ordered(problem, joined(found)) if found else ends


def _cold(problem: Problem) -> Iterator[Problem]:
    """Problems for starts, with cold touches: by the charges of all electrodes, then, if a
    temperature is unknown, without each electrode in turn, since a warm touch may be above it."""
    names = problem.model.quantities
    cold = np.array([i for i in problem.unknown if _quantity(names[i]) != "temperature_K"])
    yield replace(problem, unknown=cold)
    if len(cold) == len(problem.unknown):
        return
    for left in range(len(problem.electrodes)):
        electrodes = np.delete(problem.electrodes, left)
        charges = np.delete(problem.charges_pC, left, axis=1)
        spread = np.delete(problem.deviations_pC, left, axis=1)
        yield Problem(problem.model, electrodes, charges, spread, cold)


def _begun(cold: Problem, model: Solves, options: SolveOptions) -> Array:
    """Where first steps lead from the starts, (n, k), the likeliest first."""
    first = replace(options.search, max_steps=options.first_steps)
    ends = descend(cold, superposed(cold, model.touch, options.begin), options=first)
    return ends.at[np.argsort(ends.chi_square)]


def ordered(problem: Problem, ends: Descent) -> Descent:
    """The distinct ends; equal probes are in the order of their first coordinates."""
    touches = problem.model.scene.loaded_probes
    if len(touches) == 2 and len({pressed_alone(problem.model.scene, i) for i in (0, 1)}) == 1:
        order = [i for name in problem.model.quantities for i in [_swapped(problem, name)]]
        swap = ends.at[:, 0] > ends.at[:, len(QUANTITIES)]
        ends.at[swap] = ends.at[swap][:, order]
        ends.slopes[swap] = ends.slopes[swap][:, :, order]
    solved = ends.chi_square < 1e-6 * np.square(UNSOLVED_PC / problem.deviations_pC).min()
    ends = ends.take(np.flatnonzero(solved))
    return ends.take(distinct(problem, ends, DEFAULTS)) if ends.at.size else ends


def _swapped(problem: Problem, name: str) -> int:
    """Index of a quantity's counterpart at the other probe."""
    other = f"probe[{1 - _probe(name)}]"
    return problem.model.quantities.index(other + name[len(other) :])


def _listed(scene: Scene, touches: int, unknown: Sequence[str]) -> Scene:
    """The scene with a list of probes, each with a force of its own, apart where one is two, and
    cold where its temperature is sought."""
    probes = [*scene.loaded_probes] * (touches // len(scene.loaded_probes))
    tables = [{**plain(touch.probe), "force_N": touch.load.force_N} for touch in probes]
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
        if name not in SOUGHT:
            yield f"{name}: no quantity of a touch; choose from {', '.join(SOUGHT)}"
    if not unknown:
        yield f"unknown: nothing is sought; choose from {', '.join(SOUGHT)}"


def _quantity(name: str) -> str:
    """A quantity's name without probe and index."""
    return str([step for step in steps_of(name) if isinstance(step, str)][-1])


def _probe(name: str) -> int:
    """Index of the probe in a quantity's name."""
    return int(steps_of(name)[1]) if name.startswith("probe[") else 0
