"""Tasks that locate touches whose charges come from full solves, with noise.

Single touches are located by a response of their probe, pairs by full solves. The charges come from
solves that are finer than those behind the location.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from pvdf_fem import Replaced, Response, Scene, build_response, locate, locate_many, solve
from pvdf_fem.arrays import Array
from pvdf_fem.batch.batch import solve_scenes
from pvdf_fem.inverse.touch.touch import Touch
from pvdf_fem.progress import ignore_progress
from pvdf_fem.report.charge_map import make_ring_points
from pvdf_fem.report.results import ReportResults
from pvdf_fem.report.task import Rows, Task
from pvdf_fem.surrogate.response_options import ResponseOptions
from pvdf_fem.surrogate.touch_domain import (
    TOUCH_QUANTITIES,
    Domain,
    TouchColumn,
    apply_touch,
    draw_touches,
)

SEED = 20261124
#: Layouts of electrodes that the touches of a probe are located with.
LAYOUTS: dict[str, dict[str, Any]] = {
    "three": {"layout": "three"},
    "four": {"layout": "four"},
    "eight": {"layout": "ring", "count": 8, "shape": "square"},
}
NOISE = 0.01  #: Relative standard deviation of a charge.
PLACE_AND_FORCE = ("x_mm", "y_mm", "force_N")
TRUTH = 0.02  #: Tolerance of the full solves over the tolerance of the response.
PAIR_TRUTH = 1e-5  #: Tolerance of the full solves of pairs.
DRAWS = 200  #: Draws of the noise at a place of the map.
ONCE = 40  #: Touches that are located one by one to time them.
BATCH = 20_000  #: Touches that are located at once to time them.
PAIR_N = (0.3, 1.5)  #: Least and largest force of a touch of a pair.
LIKELY = 0.01  #: Least share of the likelihood of an alternative touch.
COARSE = ResponseOptions(error=1e-2, validation_touches=6)


class SolvedTouches(NamedTuple):
    """Touches whose full solves converge."""

    touches: Array  #: (n, 4)
    charges_pC: Array  #: (n, electrodes)


@dataclass(frozen=True)
class LocatedTouches(Task):
    """Touches of the scene's probe, located with three, four and eight electrodes.

    There are rows of three sorts: ``touch`` for a random touch at a level of noise, ``place`` for
    a place on the film under 1 N, and ``model`` for the response.
    """

    scene: Scene
    touches: int  #: Number of random touches.
    tolerance: float  #: Tolerance of the response.
    reach_mm: float
    forces_N: tuple[float, float]
    pitch_mm: float  #: Pitch of the map.
    is_coarse: bool = False  #: Whether the response is that of a preview.

    def run(self) -> Rows:
        """Build one response, and locate with each layout of the electrodes."""
        begin_s = time.process_time()
        built = build_response(
            self.with_electrodes("three"),
            self.reach_mm,
            self.forces_N,
            self.tolerance,
            1,
            options=COARSE if self.is_coarse else None,
            progress=ignore_progress,
        )
        built_s = time.process_time() - begin_s
        rows = Rows()
        for layout in LAYOUTS:
            response = built.for_scene(self.with_electrodes(layout), 1)
            about = {"sort": "model", "built_s": built_s, "error_bound": response.error_bound}
            layout_rows = [about | _measure_speed(response)]
            layout_rows += self._locate_random_touches(response)
            layout_rows += self._locate_places(response)
            rows += [{"electrodes": layout, **row} for row in layout_rows]
        return rows

    def with_electrodes(self, layout: str) -> Scene:
        """Return the scene with the electrodes of a layout."""
        return self.scene.with_(electrodes=Replaced(LAYOUTS[layout]))

    def _solve_touches(self, response: Response, touches: Array) -> SolvedTouches:
        """Solve touches (n, 4) in full, and leave out those that do not converge."""
        scenes = [apply_touch(response.scene, row, TRUTH * self.tolerance) for row in touches]
        records = solve_scenes(scenes, processes=1)
        results = ReportResults(dict(zip(scenes, records, strict=True)))
        charges = results.get_charges(scenes, response.names, "total")
        is_solved = np.isfinite(charges).all(axis=1)
        return SolvedTouches(touches[is_solved], charges[is_solved])

    def _locate_random_touches(self, response: Response) -> Rows:
        """Locate touches of any place, rotation and force.

        The rotation is known, without noise and at `NOISE`. With enough charges touches are also
        located at `NOISE` with an unknown rotation.
        """
        drawn = draw_touches(response.domain, self.touches, SEED)
        touches, charges = self._solve_touches(response, drawn)
        errors = np.random.default_rng(SEED).standard_normal(charges.shape)
        rotations = touches[:, TouchColumn.ROTATION]
        cases: list[tuple[float, Array | None]] = [(0.0, rotations), (NOISE, rotations)]
        if len(response.names) >= len(TOUCH_QUANTITIES):
            cases.append((NOISE, None))
        frames = []
        for noise, known_rotations in cases:
            noisy = charges * (1.0 + noise * errors)
            frames.append(self._locate_noisy(response, touches, noisy, noise, known_rotations))
        return pd.concat(frames).to_dict("records")

    def _locate_noisy(
        self,
        response: Response,
        touches: Array,
        charges_pC: Array,
        noise: float,
        rotations_deg: Array | None,
    ) -> pd.DataFrame:
        """Locate touches from noisy charges, and compare them with the true ones.

        Parameters
        ----------
        response : Response
            The response.
        touches : ndarray, shape (n, 4)
            True touches.
        charges_pC : ndarray, shape (n, electrodes)
            Noisy charges.
        noise : float
            Relative standard deviation of the noise.
        rotations_deg : ndarray, shape (n,), or None
            Known rotations; None where rotations are unknown.
        """
        sigma = max(noise, TRUTH * self.tolerance)
        found = locate_many(
            response,
            charges_pC,
            sigma,
            rotations_deg=rotations_deg,
            unit="pC",
            calibrated=True,
        )
        frame = pd.DataFrame(touches, columns=TOUCH_QUANTITIES)
        for name in PLACE_AND_FORCE:
            scale = frame.force_N if name == "force_N" else 1.0
            values = found.values[:, TOUCH_QUANTITIES.index(name)]
            deviations = found.deviations[:, found.unknown.index(name)]
            frame[f"{name}_error"] = (values - frame[name]) / scale
            frame[f"{name}_deviation"] = deviations / scale
        return frame.assign(
            sort="touch",
            turned=rotations_deg is None,
            alternatives=found.alternatives,
            p_value=found.p_value,
            noise=noise,
        )

    def _locate_places(self, response: Response) -> Iterator[dict[str, Any]]:
        """Yield a row for each place of the map.

        It has the error of the place that 68 % of the draws of the noise do not exceed, and the
        distance of the farthest alternative touch.
        """
        places = make_ring_points(self.reach_mm * (1.0 - 1e-6), self.pitch_mm, 90.0)
        unturned_1N = np.tile([0.0, 1.0], (len(places), 1))
        touches, charges = self._solve_touches(response, np.hstack([places, unturned_1N]))
        errors = np.random.default_rng(SEED).standard_normal((DRAWS, *charges.shape))
        rows = (charges * (1.0 + NOISE * errors)).reshape(-1, len(response.names))
        located = locate_many(response, rows, NOISE, rotations_deg=np.zeros(len(rows)), unit="pC")
        differences = (located.values.reshape(DRAWS, -1, 4) - touches)[..., :2]
        distances = np.nan_to_num(np.linalg.norm(differences, axis=-1), nan=np.inf)
        errors_mm = np.quantile(distances, 0.683, axis=0, method="higher").tolist()
        for touch, charge_row, error_mm in zip(touches.tolist(), charges, errors_mm, strict=True):
            x_mm, y_mm = touch[:2]
            readings = dict(zip(response.names, charge_row.tolist(), strict=True))
            location = locate(response, readings, NOISE, known={"rotation_deg": 0.0}, unit="pC")
            farthest_mm = 0.0
            for other in location.touches:
                if other.weight >= LIKELY:
                    distance_mm = float(np.hypot(other.x_mm - x_mm, other.y_mm - y_mm))
                    farthest_mm = max(farthest_mm, distance_mm)
            yield {
                "sort": "place",
                "x_mm": x_mm,
                "y_mm": y_mm,
                "error_mm": error_mm,
                "alternative_mm": farthest_mm,
            }


def _measure_speed(response: Response) -> dict[str, float]:
    """Measure the median time of `locate`, and the touches per second of `locate_many`."""
    touches = draw_touches(response.domain, BATCH, SEED)
    charges = response.evaluate(touches)[0]
    durations_ms = []
    for row in charges[:ONCE]:
        readings = dict(zip(response.names, row.tolist(), strict=True))
        begin_s = time.perf_counter()
        locate(response, readings, NOISE, unit="pC")
        durations_ms.append(1e3 * (time.perf_counter() - begin_s))
    begin_s = time.perf_counter()
    rotations_deg = touches[:, TouchColumn.ROTATION]
    locate_many(response, charges, NOISE, rotations_deg=rotations_deg, unit="pC")
    per_second = BATCH / (time.perf_counter() - begin_s)
    return {"locate_ms": float(np.median(durations_ms)), "per_second": per_second}


@dataclass(frozen=True)
class LocatedPair(Task):
    """Two random touches at once by probes like the scene's, located by full solves."""

    scene: Scene
    number: int  #: Seed of the random touches and of the noise.
    noise: float  #: Relative standard deviation of the charges.
    reach_mm: float
    distance_mm: float  #: Least distance of the touches.

    def run(self) -> Rows:
        """Return a row for each touch, with the nearest of the listed pairs."""
        true = self._draw_pair()
        solution = solve(self._make_scene(true))
        random = np.random.default_rng(self.number)
        factors = 1.0 + self.noise * random.standard_normal(len(solution.charges_pC))
        readings = {}
        for (name, charge), factor in zip(solution.charges_pC.items(), factors, strict=True):
            readings[name] = float(charge * factor)
        begin_s = time.process_time()
        location = locate(self.scene, readings, self.noise, unit="pC", touches=2)
        seconds = time.process_time() - begin_s
        nearest = _find_nearest_pair(location.touches, true)
        about = {"pair": self.number, "seconds": seconds, "listed": len(location.touches)}
        rows = Rows()
        for index in range(2):
            row = {
                "true": true[index].tolist(),
                "found": nearest.values[index].tolist(),
                "deviations": nearest.deviations[index].tolist(),
            }
            rows.append(about | row)
        return rows

    def _draw_pair(self) -> Array:
        """Draw x, y and force of two touches that are far enough apart, (2, 3)."""
        touches = draw_touches(Domain(self.reach_mm, PAIR_N), 20, self.number)
        columns = touches[:, [TouchColumn.X, TouchColumn.Y, TouchColumn.FORCE]]
        distances = np.linalg.norm((columns - columns[0])[:, :2], axis=1)
        second = int(np.argmax(distances >= self.distance_mm))
        return columns[[0, second]]

    def _make_scene(self, pair: Array) -> Scene:
        """Return the scene with two probes at x, y and force (2, 3)."""
        probe = self.scene.single_probe
        table = probe.model_dump(exclude_none=True) if probe else {}
        tables = [table | dict(zip(PLACE_AND_FORCE, row, strict=True)) for row in pair.tolist()]
        return self.scene.with_(probe=tables, **{"numerics.tolerance": PAIR_TRUTH})


class PairOfTouches(NamedTuple):
    """Two touches at once."""

    values: Array  #: x, y and force of each touch, (2, 3).
    deviations: Array  #: Their standard deviations, (2, 3).


def _find_nearest_pair(listed: tuple[Touch, ...], true: Array) -> PairOfTouches:
    """Find the listed pair nearest to the true one (2, 3), in either order; NaN without any."""
    nearest = PairOfTouches(np.full((2, 3), np.nan), np.full((2, 3), np.nan))
    least_mm = np.inf
    for touch in listed:
        values = np.reshape([touch.by_name[name] for name in touch.unknown], (2, 3))
        deviations = np.reshape([*touch.deviations.values()], (2, 3))
        for pair in (
            PairOfTouches(values, deviations),
            PairOfTouches(values[::-1], deviations[::-1]),
        ):
            distance_mm = np.linalg.norm((pair.values - true)[:, :2], axis=1).max()
            if distance_mm < least_mm:
                nearest = pair
                least_mm = distance_mm
    return nearest
