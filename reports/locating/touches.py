"""Touches whose charges come from full solves, located with noise: single ones by a response of
their probe, pairs by solves. The full solves are finer than what the touches are located with."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from pvdf_fem import Replaced, Response, Scene, build_response, locate, locate_many, solve
from pvdf_fem.arrays import Array
from pvdf_fem.batch.batch import solve_scenes
from pvdf_fem.progress import ignore_progress
from pvdf_fem.report.charge_map import make_ring_places
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
#: Electrodes that the touches of a probe are located with.
LAYOUTS: dict[str, dict[str, Any]] = {
    "three": {"layout": "three"},
    "four": {"layout": "four"},
    "eight": {"layout": "ring", "count": 8, "shape": "square"},
}
NOISE = 0.01  #: Relative standard deviation of a charge.
PLACE_AND_FORCE = ("x_mm", "y_mm", "force_N")
TRUTH = 0.02  #: Tolerance of the full solves over the tolerance of the response.
PAIR_TRUTH = 1e-5  #: Tolerance of the full solves of pairs.
DRAWS = 200  #: Of the noise at a place of the map.
ONCE, BATCH = 40, 20_000  #: Touches that are located one by one and at once, to time them.
PAIR_N = (0.3, 1.5)  #: Least and largest force of a touch of a pair.
LIKELY = 0.01  #: Least share of the likelihood of a rival.
COARSE = ResponseOptions(error=1e-2, validation_touches=6)


@dataclass(frozen=True)
class Located(Task):
    """Touches of the scene's probe, located with three, four and eight electrodes.

    There are rows of three sorts: of a random touch at a noise, of a place on the film under 1 N,
    and of the response.
    """

    scene: Scene
    touches: int  #: Number of random touches.
    tolerance: float  #: Of the response.
    reach_mm: float
    forces_N: tuple[float, float]
    pitch_mm: float  #: Of the map.
    is_coarse: bool = False  #: Whether the response is that of a preview.

    def run(self) -> Rows:
        """Build one response, and locate with each layout of the electrodes."""
        begun, scene = time.process_time(), self.with_electrodes("three")
        how: dict[str, Any] = {
            "options": COARSE if self.is_coarse else None,
            "progress": ignore_progress,
        }
        built = build_response(scene, self.reach_mm, self.forces_N, self.tolerance, 1, **how)
        built_s, rows = time.process_time() - begun, Rows()
        for layout in LAYOUTS:
            model = built.for_scene(self.with_electrodes(layout), 1)
            told = {"sort": "model", "built_s": built_s, "error_bound": model.error_bound}
            found = [told | _speed(model), *self._random(model), *self._places(model)]
            rows += [{"electrodes": layout, **row} for row in found]
        return rows

    def with_electrodes(self, layout: str) -> Scene:
        """The scene with the electrodes of a layout."""
        return self.scene.with_(electrodes=Replaced(LAYOUTS[layout]))

    def _solved(self, model: Response, touches: Array) -> tuple[Array, Array]:
        """The touches whose full solves converge, and their charges (n, electrodes)."""
        scenes = [apply_touch(model.scene, row, TRUTH * self.tolerance) for row in touches]
        solved = ReportResults(dict(zip(scenes, solve_scenes(scenes, processes=1), strict=True)))
        charges = solved.get_charges(scenes, model.names, "total")
        known = np.isfinite(charges).all(axis=1)
        return touches[known], charges[known]

    def _random(self, model: Response) -> Rows:
        """Touches of any place, rotation and force, whose rotation is known; and at `NOISE` those
        whose rotation is sought too, where there are charges enough."""
        touches = draw_touches(model.domain, self.touches, SEED)
        touches, charges = self._solved(model, touches)
        draw, frames = np.random.default_rng(SEED).standard_normal(charges.shape), []
        ways = [
            (0.0, touches[:, TouchColumn.ROTATION]),
            (NOISE, touches[:, TouchColumn.ROTATION]),
            (NOISE, None),
        ]
        for noise, known in ways[: 2 if len(model.names) < len(TOUCH_QUANTITIES) else 3]:
            noisy, sigma = charges * (1.0 + noise * draw), max(noise, TRUTH * self.tolerance)
            found = locate_many(model, noisy, sigma, rotations_deg=known, calibrated=True)
            frame = pd.DataFrame(touches, columns=TOUCH_QUANTITIES)
            for name in PLACE_AND_FORCE:
                column, scale = (
                    TOUCH_QUANTITIES.index(name),
                    frame.force_N if name == "force_N" else 1.0,
                )
                frame[f"{name}_error"] = (found.values[:, column] - frame[name]) / scale
                stated = found.deviations[:, found.unknown.index(name)]
                frame[f"{name}_deviation"] = stated / scale
            told = {"rivals": found.alternatives, "p_value": found.p_value, "noise": noise}
            frames.append(frame.assign(sort="touch", turned=known is None, **told))
        return pd.concat(frames).to_dict("records")

    def _places(self, model: Response) -> Iterator[dict[str, Any]]:
        """Places all over the film: the error that 68 % of the draws of the noise do not exceed,
        and the distance of the farthest rival."""
        places = make_ring_places(self.reach_mm * (1.0 - 1e-6), self.pitch_mm, 90.0)
        still = np.tile([0.0, 1.0], (len(places), 1))  # 0°, 1 N
        touches, charges = self._solved(model, np.hstack([places, still]))
        draw = np.random.default_rng(SEED).standard_normal((DRAWS, *charges.shape))
        rows = (charges * (1.0 + NOISE * draw)).reshape(-1, len(model.names))
        values = locate_many(model, rows, NOISE, rotations_deg=np.zeros(len(rows))).values
        errors = np.hypot(
            *(values.reshape(DRAWS, -1, 4) - touches)[..., : TouchColumn.ROTATION].T
        ).T
        sizes = np.quantile(np.nan_to_num(errors, nan=np.inf), 0.683, axis=0, method="higher")
        for (x, y, *_), row, size in zip(touches.tolist(), charges, sizes.tolist(), strict=True):
            listed = locate(model, _given(model, row), NOISE, known={"rotation_deg": 0.0}).touches
            likely = [np.hypot(of.x_mm - x, of.y_mm - y) for of in listed if of.weight >= LIKELY]
            rival = float(max(likely, default=0.0))
            yield {"sort": "place", "x_mm": x, "y_mm": y, "error_mm": size, "rival_mm": rival}


def _given(model: Response, charges: Array) -> dict[str, float]:
    return dict(zip(model.names, charges.tolist(), strict=True))


def _speed(model: Response) -> dict[str, Any]:
    """Milliseconds of `locate` in the median, and touches in a second by `locate_many`."""
    touches = draw_touches(model.domain, BATCH, SEED)
    charges, took = model.evaluate(touches)[0], []
    for row in charges[:ONCE]:
        begun = time.perf_counter()
        locate(model, _given(model, row), NOISE)
        took.append(1e3 * (time.perf_counter() - begun))
    begun = time.perf_counter()
    locate_many(model, charges, NOISE, rotations_deg=touches[:, TouchColumn.ROTATION])
    rate = BATCH / (time.perf_counter() - begun)
    return {"locate_ms": float(np.median(took)), "per_second": rate}


@dataclass(frozen=True)
class Pair(Task):
    """Two random touches at once by probes like the scene's, located by full solves."""

    scene: Scene
    number: int
    noise: float  #: Relative standard deviation of the charges.
    reach_mm: float
    apart_mm: float  #: Least distance of the touches.

    def run(self) -> Rows:
        """A row for each touch, beside the nearest of the pairs that are listed."""
        draw, probe = np.random.default_rng(self.number), self.scene.single_probe
        several = draw_touches(Domain(self.reach_mm, PAIR_N), 20, self.number)[
            :, [TouchColumn.X, TouchColumn.Y, TouchColumn.FORCE]
        ]
        apart = np.hypot(*(several - several[0])[:, :2].T)
        true = several[[0, int(np.argmax(apart >= self.apart_mm))]]
        pressing = probe.model_dump(exclude_none=True) if probe else {}
        both = [pressing | dict(zip(PLACE_AND_FORCE, of, strict=True)) for of in true.tolist()]
        solved = solve(self.scene.with_(probe=both, **{"numerics.tolerance": PAIR_TRUTH}))
        noise = 1.0 + self.noise * draw.standard_normal(len(solved.charges_pC))
        given = np.array([*solved.charges_pC.values()]) * noise
        begun = time.process_time()
        charges = dict(zip(solved.charges_pC, given.tolist(), strict=True))
        listed = locate(self.scene, charges, self.noise, touches=2).touches
        told = {"pair": self.number, "seconds": time.process_time() - begun, "listed": len(listed)}
        # values and deviations (2, 3), in both orders of the touches
        found = [
            [[of.by_name[name] for name in of.unknown], [*of.deviations.values()]] for of in listed
        ]
        orders = [np.reshape(of, (2, 2, 3))[:, ::step] for of in found for step in (1, -1)]
        sizes = [np.linalg.norm((of[0] - true)[:, :2], axis=1).max() for of in orders]
        nearest = orders[int(np.argmin(sizes))] if orders else np.full((2, 2, 3), np.nan)
        return [
            {**told, "true": of, "found": at, "deviations": wide}
            for of, at, wide in zip(true.tolist(), *nearest.tolist(), strict=True)
        ]
