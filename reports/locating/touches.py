"""Touches whose charges come from full solves, located with noise: single ones by a response of
their probe, pairs by solves. The full solves are much finer than what they are located with."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pvdf_fem import Response, Scene, build_response, locate, locate_many, solve
from pvdf_fem.arrays import Array
from pvdf_fem.reporting.charge_map import places_on_rings
from pvdf_fem.reporting.solved import Solved
from pvdf_fem.reporting.task import Rows, Task
from pvdf_fem.response.build import ResponseOptions
from pvdf_fem.response.held_out import random_touches
from pvdf_fem.response.model import QUANTITIES, scene_of_touch
from pvdf_fem.response.probe_stress import ProbeMesh
from pvdf_fem.scene.scene import Replaced
from pvdf_fem.sweeps.sweep import silent, solve_all
from pvdf_fem.touch.by_solves import SolveOptions

SEED = 20261124
#: Electrodes that the touches of a probe are located with.
LAYOUTS: dict[str, dict[str, Any]] = {
    "three": {"layout": "three"},
    "four": {"layout": "four"},
    "eight": {"layout": "ring", "count": 8, "shape": "square"},
}
NOISES = (0.0, 0.003, 0.01, 0.03)  #: Relative standard deviations of a charge.
NOISE = 0.01  #: Of the map.
PLACE_AND_FORCE = ("x_mm", "y_mm", "force_N")
TRUTH = 0.02  #: Tolerance of the full solves over the tolerance of the response.
FORCE_N = 1.0  #: Of the touches of the map, which are not turned.
DRAWS = 200  #: Of the noise at a place of the map.
BATCH = 20_000  #: Touches that are located at once to time them.
LIKELY = 0.01  #: Least share of the likelihood of a rival.
PAIR_TRUTH = 1e-5  #: Tolerance of the full solves of pairs.
COARSE_PAIRS = SolveOptions(
    pitch_mm=7.5, fine_mm=2.5, starts=3, followed=1, rounds=0, tolerance=1e-3
)


@dataclass(frozen=True)
class Located(Task):
    """Touches of the scene's probe, located with three, four and eight electrodes.

    There are three sorts of rows: of a random touch at a noise, of a place on the film under
    `FORCE_N`, and one of the response.
    """

    scene: Scene
    touches: int  #: Number of random touches.
    tolerance: float  #: Of the response.
    reach_mm: float
    forces_N: tuple[float, float]
    pitch_mm: float  #: Of the map.
    is_coarse: bool = False  #: Whether the response is a coarse one, for a preview.

    def run(self) -> Rows:
        """Build one response, and locate with each layout of the electrodes."""
        begun, rows = time.process_time(), Rows()
        options = ResponseOptions(radii=2, held_out=6, cell=1 / 6, elements=ProbeMesh().scaled(2.0))
        built = build_response(
            self._with("three"),
            self.reach_mm,
            self.forces_N,
            self.tolerance,
            1,
            progress=silent,
            options=options if self.is_coarse else None,
        )
        seconds = time.process_time() - begun
        for layout in LAYOUTS:
            model = built.for_scene(self._with(layout), 1)
            found = [*self._random(model), *self._places(model), self._speed(model)]
            rows += [{"electrodes": layout, "build_s": seconds, **row} for row in found]
        return rows

    def _with(self, layout: str) -> Scene:
        return self.scene.with_(electrodes=Replaced(LAYOUTS[layout]))

    def _charges(self, model: Response, touches: Array) -> Array:
        """Charges (n, electrodes) of full solves, NaN where one fails."""
        scenes = [scene_of_touch(model.scene, row, TRUTH * self.tolerance) for row in touches]
        records = solve_all(scenes, processes=1)
        return Solved(dict(zip(scenes, records, strict=True))).charges(scenes, model.names, "total")

    def _random(self, model: Response) -> Iterator[dict[str, Any]]:
        """Touches everywhere, of any rotation and force: located with the rotation known, and at
        `NOISE` with the rotation sought."""
        touches = random_touches(model.domain, self.touches, SEED)
        charges, draw = self._charges(model, touches), np.random.default_rng(SEED)
        ways = [(noise, PLACE_AND_FORCE) for noise in NOISES]
        if self.scene.single_probe and self.scene.single_probe.period_deg:
            ways += [(NOISE, QUANTITIES)] * (len(model.names) >= len(QUANTITIES))
        for noise, unknown in ways:
            noisy = charges * (1.0 + noise * draw.standard_normal(charges.shape))
            for touch, row in zip(touches, noisy, strict=True):
                if np.isfinite(row).all():
                    yield {"sort": "touch", "noise": noise, **located(model, touch, row, noise, unknown)}

    def _places(self, model: Response) -> Iterator[dict[str, Any]]:
        """Places all over the film: the error within which 68 % of the draws are, and the distance
        of the farthest rival."""
        places = places_on_rings(self.reach_mm * (1.0 - 1e-6), self.pitch_mm, 90.0)
        touches = np.pad(places, ((0, 0), (0, 2)), constant_values=(0.0, 0.0))
        touches[:, 3] = FORCE_N
        charges = self._charges(model, touches)
        draw = np.random.default_rng(SEED).standard_normal((len(charges), DRAWS, charges.shape[1]))
        rows = (charges[:, None] * (1.0 + NOISE * draw)).reshape(-1, charges.shape[1])
        found = locate_many(model, rows, NOISE, rotations_deg=np.zeros(len(rows))).values
        apart = np.linalg.norm(found.reshape(len(places), DRAWS, 4)[:, :, :2] - places[:, None], axis=2)
        errors = np.quantile(np.nan_to_num(apart, nan=np.inf), 0.683, axis=1, method="higher")
        for place, row, error in zip(places, charges, errors.tolist(), strict=True):
            known, rival = dict(zip(model.names, row.tolist(), strict=True)), 0.0
            for touch in locate(model, known, NOISE, known={"rotation_deg": 0.0}).touches:
                if touch.weight >= LIKELY:
                    rival = max(rival, float(np.linalg.norm(touch.values[:2] - place)))
            yield {
                "sort": "place",
                **dict(zip(("x_mm", "y_mm"), place.tolist(), strict=True)),
                "error_mm": error,
                "rival_mm": rival,
            }

    def _speed(self, model: Response) -> dict[str, Any]:
        """The response's error bound, and touches located in a second when many are given."""
        touches = random_touches(model.domain, BATCH, SEED)
        charges = model.evaluate(touches)[0]
        charges *= 1.0 + NOISE * np.random.default_rng(SEED).standard_normal(charges.shape)
        begun = time.perf_counter()
        locate_many(model, charges, NOISE, rotations_deg=touches[:, 2])
        rate = BATCH / (time.perf_counter() - begun)
        return {"sort": "model", "error_bound": model.error_bound, "rate_per_s": rate}


def located(
    model: Response, touch: Array, charges: Array, noise: float, unknown: Sequence[str]
) -> dict[str, Any]:
    """What `locate` finds of a touch (4,) from charges (electrodes,): errors, and deviations that
    are stated; of the force relative ones. NaN where no touch is found."""
    true = dict(zip(QUANTITIES, touch.tolist(), strict=True))
    given = dict(zip(model.names, charges.tolist(), strict=True))
    known = {name: value for name, value in true.items() if name not in unknown}
    sigma, begun = max(noise, TRUTH * model.tolerance), time.perf_counter()
    location = locate(model, given, sigma, unknown=unknown, known=known)
    row = {**true, "sought": len(unknown), "seconds": time.perf_counter() - begun}
    best = location.best.values if location.touches else np.full(4, np.nan)
    stated = location.deviations if location.touches else {}
    listed = [np.linalg.norm(of.values[:2] - touch[:2]) for of in location.touches]
    errors = dict(zip(QUANTITIES, (best - touch).tolist(), strict=True))
    for name in PLACE_AND_FORCE:
        scale = touch[3] if name == "force_N" else 1.0
        row[f"{name}_error"] = errors[name] / scale
        row[f"{name}_deviation"] = stated.get(name, np.nan) / scale
    return {
        **row,
        "error_mm": float(np.hypot(errors["x_mm"], errors["y_mm"])),
        "nearest_mm": float(min(listed, default=np.nan)),
        "rivals": location.alternatives,
        "p_value": location.best.p_value if location.touches else np.nan,
    }


@dataclass(frozen=True)
class Pair(Task):
    """Two random touches at once by probes like the scene's, located by full solves."""

    scene: Scene
    number: int
    noise: float  #: Relative standard deviation of the charges.
    reach_mm: float
    apart_mm: float  #: Least distance of the two touches.
    is_coarse: bool = False

    def run(self) -> Rows:
        """A row for each touch, beside the touch of the listed pair that is nearest to the truth."""
        draw, true = np.random.default_rng([SEED, self.number]), np.zeros((2, 3))
        while np.linalg.norm(true[0, :2] - true[1, :2]) < self.apart_mm:
            r, angle = self.reach_mm * np.sqrt(draw.random(2)), 2.0 * np.pi * draw.random(2)
            true = np.stack([r * np.cos(angle), r * np.sin(angle), 0.3 * 5.0 ** draw.random(2)], 1)
        charges = solve(self._pressed(true)).charges_pC
        noise = 1.0 + self.noise * draw.standard_normal(len(charges))
        given = {name: q * f for (name, q), f in zip(charges.items(), noise.tolist(), strict=True)}
        begun, options = time.process_time(), COARSE_PAIRS if self.is_coarse else SolveOptions()
        found = locate(self.scene, given, self.noise, touches=2, options=options)
        told = {"pair": self.number, "seconds": time.process_time() - begun, "listed": len(found)}
        orders = [(of, turn) for of in found for turn in (0, 1)]
        if not orders:
            raise ValueError(f"no pair is found from the charges of {true.tolist()}")

        def errors(order: tuple[Any, int]) -> Array:
            """Distances in mm of both places."""
            values = np.roll(np.reshape([*order[0].values.values()], (2, 3)), order[1], axis=0)
            return np.linalg.norm((values - true)[:, :2], axis=1)

        best = min(orders, key=lambda order: errors(order).max())
        values, stated = (
            np.roll(np.reshape([*of.values()], (2, 3)), best[1], axis=0)
            for of in (best[0].values, best[0].deviations)
        )
        told |= {"place": found.index(best[0]), "weight": best[0].weight}
        return [
            {
                **told,
                **dict(zip(PLACE_AND_FORCE, row, strict=True)),
                **dict(zip((f"{name}_found" for name in PLACE_AND_FORCE), is_at, strict=True)),
                "error_mm": error,
                "deviation_mm": float(np.hypot(*wide[:2])),
            }
            for row, is_at, error, wide in zip(
                true.tolist(), values.tolist(), errors(best).tolist(), stated, strict=True
            )
        ]

    def _pressed(self, touches: Array) -> Scene:
        """The scene with touches (2, 3), to be solved finely."""
        probe = self.scene.single_probe
        assert probe is not None
        given = [dict(zip(PLACE_AND_FORCE, row, strict=True)) for row in touches.tolist()]
        both = [{**probe.model_dump(exclude_none=True), **of} for of in given]
        return self.scene.with_(probe=both, **{"numerics.tolerance": PAIR_TRUTH})
