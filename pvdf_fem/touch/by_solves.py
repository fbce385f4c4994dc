"""One or two touches from charges by full solves, with tangential forces or temperatures.

No model of the charges is built: each step of a Levenberg-Marquardt search solves the scene, and
its slopes are the adjoint derivatives. Searches start where charges of single touches, added up,
are most like the measured ones. All touches that explain the charges are listed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import combinations, product
from typing import Any

import numpy as np
from scipy.interpolate import RBFInterpolator

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.charges.goals import goals_of
from pvdf_fem.derivatives.parameters import parameters_of
from pvdf_fem.derivatives.rates import charge_rates
from pvdf_fem.film.loads.profiles import pinned
from pvdf_fem.response.model import Domain, room_mm
from pvdf_fem.scene.change import number_at, plain, steps_of
from pvdf_fem.scene.outlines.shape import HEAT
from pvdf_fem.scene.scene import Numerics, Scene, SceneError
from pvdf_fem.scene.shapes import Pressing
from pvdf_fem.solution.solution import NotConvergedError
from pvdf_fem.solution.solve import solve_goals
from pvdf_fem.sweeps.sweep import solve_all
from pvdf_fem.touch.least_squares import Descent, SearchOptions, descend, joined
from pvdf_fem.touch.measurement import Deviations, Measurement, rest_of
from pvdf_fem.touch.mistakes import charge_mistakes
from pvdf_fem.touch.touch import Fit, explains, p_values

#: What may be sought, with the longest step of a search in mm, degrees, factors e, N and K.
LONGEST = {
    "x_mm": 2.5,
    "y_mm": 2.5,
    "rotation_deg": 20.0,
    "force_N": 0.5,
    "tangential_N": 1.0,
    "temperature_K": 5.0,
}
CLOSE = 0.15  #: Searches that are closer than this share of the longest step go on as one.
#: Charges of touches are those of single ones, added up, with each force times this power of the
#: sum of all shares: their common tension makes the film stiffer.
STIFFENING = 0.35
REACH = 1.5  #: How far out touches are sought, over the distance of the farthest electrode.
FAR = 1e6  #: Residual over its deviation of a scene that cannot be solved.


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
    #: Distance in mm of the places of single touches that are solved, and that are compared.
    pitch_mm: float = 2.5
    fine_mm: float = 1.0
    #: Number of starts, their least distance, and how many go on after some first steps; the others
    #: go on where these lead to no touch that explains the charges.
    starts: int = 25
    apart_mm: float = 3.0
    first_steps: int = 3
    followed: int = 5
    #: Charges of which a larger chi-square is less probable than this are not explained.
    significance: float = 0.05
    max_steps: int = 40
    #: Starts about the best end, in longest steps along what the charges determine least.
    valley: tuple[float, ...] = (-2.0, -1.0, 1.0, 2.0)
    #: How often that is done again where it led to a better end.
    rounds: int = 3
    #: Starts about the best of the last ends, along the same, in standard deviations.
    near: tuple[float, ...] = (-2.0, 2.0)
    #: Chi-square that a last step may gain, and above the least one up to which touches are listed.
    arrived: float = 0.02
    listed: float = 25.0
    #: Two ends of searches are one if chi-square between them, by the slopes, is less than this.
    same: float = 0.1


DEFAULTS = SolveOptions()


@dataclass(frozen=True, eq=False)
class Touches(Fit):
    """Values of the unknown, by key of a scene with a list of probes, that explain some charges."""

    #: That scene, with all values.
    scene: Scene

    @property
    def values(self) -> dict[str, float]:
        """Of the unknown, by key."""
        return {key: number_at(self.scene, key) for key in self.unknown}

    @property
    def remarks(self) -> tuple[str, ...]:
        """What keeps the touches from being the answer, in sentences."""
        texts = []
        if not explains(np.array([self.chi_square]), len(self.jacobian) - len(self.unknown)).all():
            texts.append(f"unexplained: no touches fit; chi-square {self.chi_square:.3g}")
        if self.at_edge:
            texts.append("at the edge of where touches are sought (reach_mm): one may lie beyond")
        return tuple(texts)

    def to_json(self) -> dict[str, Any]:
        """Plain values for JSON."""
        spread = {"standard_deviations": self.deviations, "covariance": self.covariance.tolist()}
        return {**self.values, **spread, **self.fit_json(), "remarks": list(self.remarks)}


def locate_by_solves(
    scene: Scene,
    charges_pC: Mapping[str, float],
    sigma: Deviations = 0.01,
    *,
    touches: int = 1,
    unknown: Sequence[str] = ("x_mm", "y_mm", "force_N"),
    noise_pC: Deviations | None = None,
    reading: str | None = None,
    options: SolveOptions = DEFAULTS,
) -> tuple[Touches, ...]:
    """All touches that may have given some charges, the likeliest first; none where no search ends.

    `touches`, 1 or 2, is the number of probes that touch at once: those of the scene's list, or
    its one probe. `unknown`, of x_mm, y_mm, rotation_deg, force_N, tangential_N and temperature_K,
    is sought of each, the rest is the scene's. Readings, `sigma`, `noise_pC` and `reading` are as
    in `locate`. Places are sought within `options.reach_mm` of the centre.

    Raises `ValueError` with a line for each mistake.
    """
    mistakes = [*charge_mistakes(scene, charges_pC, sigma, noise_pC, reading)]
    if mistakes := [*mistakes, *_mistakes(scene, touches, unknown)]:
        raise ValueError("\n".join(mistakes))
    listed = _listed(scene, touches, unknown)
    keys = _keys(listed, unknown)
    if len(charges_pC) < len(keys):
        raise ValueError(
            f"charges: {len(charges_pC)} channels do not tell {len(keys)} unknown quantities"
            f" ({', '.join(keys)}); give more electrodes, or seek less"
        )
    if wrong := set(keys) - set(parameters_of(listed)):
        raise ValueError(f"unknown: charges have no derivative by {', '.join(sorted(wrong))}")

    reach_mm = reach_by_electrodes_mm(scene) if options.reach_mm is None else options.reach_mm

    def posed(tolerance: float) -> Search:
        none, domain = np.empty(0), Domain(reach_mm, (1e-3, 1e3))
        search = Search(listed, keys, domain, tolerance, np.empty(0, int), none, none)
        measurement = Measurement.of(search, tuple(charges_pC), sigma, noise_pC, reading)
        readings = np.array([list(charges_pC.values())], dtype=float)
        problem = measurement.problem(readings, np.empty(0, int))
        numbers = {"charges_pC": problem.charges_pC[0], "spread_pC": problem.deviations_pC[0]}
        return replace(search, electrodes=problem.electrodes, **numbers)

    coarse, fine = posed(options.first_tolerance), posed(options.tolerance)
    begun, freedom = _begun(coarse, options), len(charges_pC) - len(keys)
    ends = _searched(coarse, fine, [likely[: options.followed] for likely in begun], options)
    if not explains(ends.chi_square[:1], freedom, options.significance).any():
        more = _searched(coarse, fine, [likely[options.followed :] for likely in begun], options)
        ends = fine.distinct(joined([ends, more]), options)
    return fine.fits(ends)


def reach_by_electrodes_mm(scene: Scene) -> float:
    """Where touches are sought, by the farthest electrode, and with their probes on the film."""
    farthest_mm = max(1e3 * float(np.hypot(*e.outline.centroid)) for e in scene.electrode_list)
    return min(REACH * farthest_mm, room_mm(scene))


def _begun(search: Search, options: SolveOptions) -> list[Array]:
    """Where first steps lead from the starts, (n, keys), the likeliest first; one for each of the
    searches for cold touches."""
    begun = []
    for cold in search.of_cold_touches():
        first = replace(cold.how(options), max_steps=options.first_steps)
        ends = descend(cold, _starts(cold, options), options=first)
        begun.append(np.zeros((len(ends.at), len(search.keys))))
        begun[-1][:, np.isin(search.keys, cold.keys)] = ends.at[np.argsort(ends.chi_square)]
    return begun


def _searched(
    coarse: Search, fine: Search, starts: Sequence[Array], options: SolveOptions
) -> Descent:
    """Distinct ends of fine searches, which start where coarse ones end, and near the best."""
    how = coarse.how(options)
    ends = coarse.distinct(descend(coarse, np.concatenate(starts), options=how), options)
    for _ in range(options.rounds if ends.at.size else 0):
        least = ends.chi_square[0]
        ends = coarse.along_valley(ends, np.array(options.valley), options)
        if ends.chi_square[0] > least - how.arrived:
            break
    if ends.at.size:
        ends = fine.distinct(descend(fine, ends.at, options=fine.how(options)), options)
    if ends.at.size:
        deviation = 1.0 / float(np.linalg.norm(ends.slopes[0] @ fine.along(ends)))
        ends = fine.along_valley(ends, min(deviation, 1.0) * np.array(options.near), options)
    return ends


@dataclass(frozen=True, eq=False)
class Search:
    """The least-squares problem for `descend`: coordinates are values by key, of forces the log."""

    #: With a list of probes.
    scene: Scene
    keys: tuple[str, ...]
    domain: Domain
    #: Tolerance of solves.
    error_bound: float
    #: Which of the scene's electrodes have charges; these, and their deviations.
    electrodes: Indices
    charges_pC: Array
    spread_pC: Array

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the electrodes."""
        return tuple(electrode.name for electrode in self.scene.electrode_list)

    @cached_property
    def longest(self) -> Array:
        """Longest steps."""
        return np.array([LONGEST[_name(key)] for key in self.keys])

    @property
    def close(self) -> Array:
        """Distances up to which searches go on as one."""
        return CLOSE * self.longest

    @cached_property
    def _is_force(self) -> Mask:
        return np.array([_name(key) == "force_N" for key in self.keys])

    def how(self, options: SolveOptions) -> SearchOptions:
        """How searches go."""
        ends: dict[str, float] = {"arrived": options.arrived, "short": 0.04, "relief": 0.3}
        return SearchOptions(options.max_steps, **ends)

    def of_cold_touches(self) -> Iterator[Search]:
        """The searches that give starts: itself, or those by the charges of cold touches, all of
        them and all but one, which may be that of an electrode under a warm touch."""
        keys = tuple(key for key in self.keys if _name(key) != "temperature_K")
        yield replace(self, keys=keys)
        for electrode in self.electrodes if keys != self.keys else ():
            others = self.electrodes != electrode
            known = {"charges_pC": self.charges_pC[others], "spread_pC": self.spread_pC[others]}
            yield replace(self, keys=keys, electrodes=self.electrodes[others], **known)

    def evaluate(self, touches: Array) -> tuple[Array, Array]:
        """Charges (n, electrodes) and slopes (n, electrodes, keys) at coordinates, NaN if none."""
        solved, shape = [*map(self._solved, touches)], (len(self.names), len(self.keys))
        charges = np.array([charges for charges, _ in solved]).reshape(-1, shape[0])
        return charges, np.array([slopes for _, slopes in solved]).reshape(-1, *shape)

    def _solved(self, at: Array) -> tuple[Array, Array]:
        try:
            solution = solve_goals(scene := self.at(at), goals_of(scene))
            rates = 1e12 * charge_rates(solution, self.keys)
        except (SceneError, NotConvergedError):
            none = np.full((len(self.names), len(self.keys)), np.nan)
            return none[:, 0], none
        return np.array(list(solution.charges_pC.values())), rates.T * self.units(at)

    def units(self, at: Array) -> Array:
        """What a change of the coordinates is multiplied by to be one of the values."""
        return np.where(self._is_force, np.exp(np.where(self._is_force, at, 0.0)), 1.0)

    def at(self, at: Array) -> Scene:
        """The scene at coordinates."""
        values = np.where(self._is_force, self.units(at), at).tolist()
        changes = dict(zip(self.keys, values, strict=True))
        return self.scene.with_(**changes, **{"numerics.tolerance": self.error_bound})

    @cached_property
    def _places(self) -> list[int]:
        """Where the coordinates x, y of places that are sought begin."""
        names = [*map(_name, self.keys)]
        return [i for i in range(len(names)) if names[i : i + 2] == ["x_mm", "y_mm"]]

    def held_back(self, at: Array) -> Array:
        """Coordinates with places moved to the nearest within reach."""
        moved, reach = at.copy(), 1.05 * self.domain.reach_mm
        for x in self._places:
            distance = np.hypot(at[:, x], at[:, x + 1])
            moved[:, x : x + 2] *= (reach / np.maximum(distance, reach))[:, None]
        return moved if (moved != at).any() else at

    def _farthest_mm(self, at: Array) -> float:
        """Distance of the farthest place from the centre."""
        return max((float(np.hypot(at[x], at[x + 1])) for x in self._places), default=0.0)

    def linearised(self, at: Array, rows: Indices | None = None) -> Array:
        """Differences of charges, then slopes, over deviations, (n, electrodes, 1 + keys)."""
        charges, slopes = self.evaluate(at)
        system = np.concatenate([charges[:, :, None], slopes], axis=2)[:, self.electrodes]
        system[:, :, 0] -= self.charges_pC
        system /= self.spread_pC[:, None]
        lost = np.isnan(system).any(axis=(1, 2))
        system[lost], system[lost, :, 0] = 0.0, FAR
        return system

    def along(self, ends: Descent) -> Array:
        """A longest step from the best end along what the charges determine least."""
        weak = np.linalg.svd(ends.slopes[0] * self.longest)[2][-1]
        return np.asarray(self.longest * weak / np.abs(weak).max())

    def along_valley(self, ends: Descent, steps: Array, options: SolveOptions) -> Descent:
        """The ends with those of searches that start such steps (n,) away from the best."""
        starts = ends.at[0] + steps[:, None] * self.along(ends)
        more = descend(self, starts, options=self.how(options))
        return self.distinct(joined([ends, more]), options)

    def distinct(self, ends: Descent, options: SolveOptions) -> Descent:
        """The likely ends that do not repeat a better one, the best first.

        Equal probes are in the order of their first coordinates.
        """
        half, probes = len(self.keys) // 2, range(len(self.scene.loaded_probes))
        if len(probes) == 2 and len({_alone(self.scene, i) for i in probes}) == 1:
            swap, order = ends.at[:, 0] > ends.at[:, half], np.roll(np.arange(2 * half), half)
            ends.at[swap] = ends.at[swap][:, order]
            ends.slopes[swap] = ends.slopes[swap][:, :, order]
        order = ends.ranking.argsort(kind="stable")
        rows = order[ends.ranking[order] <= ends.ranking.min(initial=np.inf) + options.listed]
        kept = rows[:0]
        while len(rows := rows[ends.chi_square[rows] < FAR]):
            apart = (ends.at[rows] - ends.at[rows[0]]) @ ends.slopes[rows[0]].T
            kept = np.append(kept, rows[0])
            rows = rows[np.square(apart).sum(axis=1) >= options.same]
        return ends.take(kept)

    def fits(self, ends: Descent) -> tuple[Touches, ...]:
        """The touches at the ends of searches, with the weights that Laplace's method gives."""
        extent, channels = 4.0 * self.longest, len(self.electrodes)
        slopes = ends.slopes * extent
        normal = np.matmul(slopes.swapaxes(1, 2), slopes) + np.eye(len(extent))
        logs = -0.5 * (ends.chi_square + np.log(np.linalg.det(normal)))
        weights = np.exp(logs - np.logaddexp.reduce(logs)) if len(logs) else logs
        chances = p_values(ends.chi_square, channels - len(self.keys))
        found = []
        for row in np.argsort(-weights):
            at, chi_square = ends.at[row], float(ends.chi_square[row])
            lengths = ends.slopes[row] / self.units(at), extent * self.units(at)
            likely = float(chances[row]), float(weights[row])
            edge = ("reach_mm",) if self._farthest_mm(at) >= self.domain.reach_mm else ()
            found.append(Touches(self.keys, *lengths, chi_square, *likely, edge, self.at(at)))
        return tuple(found)


def _starts(search: Search, options: SolveOptions) -> Array:
    """Starts (n, keys) where charges of single touches, added up, are most like those measured."""
    scene, how = search.scene, (search.domain.reach_mm, options.pitch_mm, options.fine_mm)
    rest = np.nan_to_num(rest_of(scene)[0, search.electrodes])
    alone = pinned(_alone(scene, i) for i in range(len(scene.loaded_probes)))
    tables = [_single(one, *how) for one in alone]
    changes = np.concatenate([(c[:, search.electrodes] - rest) for _, c in tables])
    changes, places = changes / search.spread_pC, np.concatenate([p for p, _ in tables])
    count, alike = len(tables[0][0]), tables[0] is tables[-1]
    sets = [range(count), range(count, len(places))][: len(tables)]
    chosen = np.array([*(combinations(sets[0], len(sets)) if alike else product(*sets))])
    gram, right = changes @ changes.T, changes @ ((search.charges_pC - rest) / search.spread_pC)
    normal = gram[chosen[:, :, None], chosen[:, None, :]]
    normal = normal + 1e-9 * gram.diagonal().mean() * np.eye(len(sets))
    shares = np.linalg.solve(normal, right[chosen][:, :, None])[:, :, 0]
    explained = (right[chosen] * shares).sum(axis=1)
    pressing = (shares > 0.03 * np.abs(shares).sum(axis=1, keepdims=True)).all(axis=1)
    order = np.argsort(-np.where(pressing, explained, -np.inf))[: pressing.sum()]
    at, kept = np.empty((0, len(search.keys))), np.empty((0, len(sets), 2))
    for row in order:
        there = places[chosen[row]]
        if (np.abs(kept - there).max(axis=(1, 2), initial=0.0) < options.apart_mm).any():
            continue
        kept = np.append(kept, there[None], axis=0)
        forces = shares[row] * shares[row].sum() ** STIFFENING
        known = {f"probe[{i}].force_N": np.log(force) for i, force in enumerate(forces)}
        for i, (x, y) in enumerate(there):
            known |= {f"probe[{i}].x_mm": x, f"probe[{i}].y_mm": y}
        values = [known[key] if key in known else number_at(scene, key) for key in search.keys]
        at = np.append(at, [values], axis=0)
        if len(at) == options.starts:
            break
    return at


@lru_cache(maxsize=8)
def _single(scene: Scene, reach_mm: float, pitch_mm: float, fine_mm: float) -> tuple[Array, Array]:
    """Places (n, 2) within reach, and charges (n, electrodes) of a touch there.

    Those of a probe turned with its place, which a round film gives by few solves, interpolated.
    """
    places = []
    for radius in np.linspace(0.0, reach_mm, round(reach_mm / pitch_mm) + 1):
        count = max(1, round(2.0 * np.pi * radius / pitch_mm))
        places += [(radius, 360.0 * i / count) for i in range(count)]
    radii, turns = np.array(places).T
    solved = radii[:, None] * np.stack([np.cos(np.radians(turns)), np.sin(np.radians(turns))], -1)
    keys = ("probe.x_mm", "probe.y_mm", "probe.rotation_deg")
    rows = np.column_stack([solved, turns]).tolist()
    scenes = [scene.with_(**dict(zip(keys, row, strict=True))) for row in rows]
    records = solve_all(scenes, processes=1)
    good = [i for i, record in enumerate(records) if record.converged]
    if len(good) < 3:
        raise NotConvergedError(f"{records[0].status}: one touch alone: {records[0].reason}")
    reads = scene.film.d31_pC_N, scene.film.d32_pC_N, scene.numerics.observable
    charges = np.array([[*records[i].charges_pC(*reads).values()] for i in good])
    ticks = np.arange(-reach_mm, reach_mm + 0.5 * fine_mm, fine_mm)
    grid = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    grid = grid[np.hypot(*grid.T) <= reach_mm]
    return grid, RBFInterpolator(solved[good], charges)(grid)


def _alone(scene: Scene, number: int) -> Scene:
    """One of a scene's probes on the centre, under 1 N and cold."""
    touch = scene.loaded_probes[number]
    place = dict.fromkeys(("x_mm", "y_mm", "rotation_deg"), 0.0)
    unsaid = dict.fromkeys((*Pressing.model_fields, *HEAT))
    probe = touch.probe.model_copy(update=place | unsaid)
    load = touch.load.model_copy(update={"force_N": 1.0, "tangential_N": None})
    numerics = Numerics(tolerance=1e-2, observable=scene.numerics.observable)
    return scene.with_(probe=probe, load=load, numerics=numerics, readout=None)


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


def _keys(scene: Scene, unknown: Sequence[str]) -> tuple[str, ...]:
    """Keys of what is sought of each probe of a list; a disc has no rotation."""
    keys = []
    for touch in scene.loaded_probes:
        names = [name for name in LONGEST if name in unknown]
        if not touch.probe.period_deg and "rotation_deg" in names:
            names.remove("rotation_deg")
        for name in names:
            ends = ("[0]", "[1]") if name == "tangential_N" else ("",)
            keys += [f"{touch.key}.{name}{end}" for end in ends]
    return tuple(keys)


def _mistakes(scene: Scene, touches: int, unknown: Sequence[str]) -> Iterator[str]:
    """What keeps a scene from being searched, by key."""
    if touches not in (1, 2):
        yield f"touches = {touches}: give 1 or 2"
    elif len(scene.loaded_probes) not in (1, touches):
        yield f"probe: the scene has {len(scene.loaded_probes)}; give {touches}, or one for both"
    elif touches > len(scene.loaded_probes) and not {"x_mm", "y_mm"} <= set(unknown):
        yield "unknown: both touches of one probe need x_mm and y_mm; add them, or give [[probe]]"
    if scene.stage is not None:
        yield "stage: places by full solves are those of the film; remove the table"
    if any(touch.load.depth_mm is not None for touch in scene.loaded_probes):
        yield "load.depth_mm: forces are sought here; give load.force_N"
    if "temperature_K" in unknown:
        if scene.film.pyroelectric_uC_m2K is None:
            yield "film.pyroelectric_uC_m2K: not given; it tells temperature_K, so give it"
        if any(touch.probe.contact_time_s is None for touch in scene.loaded_probes):
            yield "probe.contact_time_s: not given; heat spreads meanwhile, so give it"
    for name in unknown:
        if name not in LONGEST:
            yield f"{name}: no quantity of a touch; choose from {', '.join(LONGEST)}"
    if not unknown:
        yield f"unknown: nothing is sought; choose from {', '.join(LONGEST)}"


def _name(key: str) -> str:
    return str(steps_of(key)[2])
