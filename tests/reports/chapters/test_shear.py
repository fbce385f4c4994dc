"""Can it feel shear: deviations and telling noises of sensors whose charges are linear."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from pvdf_fem import Scene
from pvdf_fem.arrays import Array
from reports.chapters import shear

#: Slopes of six relative charges over x, y in mm, force down, Fx and Fy in N, (6, 5).
SLOPES = np.array(
    [
        [0.05, 0.00, 0.6, 0.004, 0.000],
        [0.00, 0.05, 0.6, 0.000, 0.004],
        [0.00, 0.00, 0.6, 0.000, 0.000],
        [0.00, 0.00, 0.0, 0.010, 0.000],
        [0.00, 0.00, 0.0, 0.000, 0.002],
        [0.00, 0.00, 0.0, 0.000, 0.000],
    ]
)


@dataclass(frozen=True)
class Linear:
    """A sensor whose charges are linear in place and forces."""

    slopes: Array

    def charges_pC(self, scene: Scene) -> dict[str, float]:
        assert scene.single_probe is not None
        force, along = scene.load.force_N, scene.load.tangential_N or (0.0, 0.0)
        at = np.array([scene.single_probe.x_mm, scene.single_probe.y_mm, force, *along])
        return dict(zip("ABCDEF", (100.0 * (1.0 + self.slopes @ at)).tolist(), strict=True))

    def solve(self, scene: Scene) -> SimpleNamespace:
        return SimpleNamespace(charges_pC=self.charges_pC(scene))

    def located(
        self, scene: Scene, charges: dict[str, float], sigma: float, **options: object
    ) -> list[SimpleNamespace]:
        """The best touch straight down by linear least squares, and a worse one before it."""
        assert scene.load.tangential_N is None
        measured = np.array(list(charges.values()))
        missing = (measured - list(self.charges_pC(scene).values())) / (sigma * measured)
        columns = 100.0 * self.slopes[:, :3] / (sigma * measured[:, None])
        residual = missing - columns @ np.linalg.lstsq(columns, missing)[0]
        chi_square = float(residual @ residual)
        return [
            SimpleNamespace(chi_square=2.0 * chi_square),
            SimpleNamespace(chi_square=chi_square),
        ]


def told(slopes: Array, monkeypatch: pytest.MonkeyPatch) -> float:
    sensor = Linear(slopes)
    monkeypatch.setattr(shear, "solve", sensor.solve)
    monkeypatch.setattr(shear, "locate_by_solves", sensor.located)
    return shear.telling_noise(shear.Sensor(), (0.0, 0.0))


def test_telling_noise_is_half_of_what_no_touch_straight_down_explains(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """D and E see only Fx and Fy; 30° is the direction that leaves more of either, 120° less."""
    turned = np.radians(shear.DIRECTIONS_DEG)
    along = shear.ALONG_N * np.stack([0.010 * np.cos(turned), 0.002 * np.sin(turned)])
    expected = 0.5 * np.linalg.norm(along / (1.0 + along), axis=0).min()
    assert told(SLOPES, monkeypatch) == pytest.approx(expected, rel=1e-9)


def test_shear_that_a_shift_explains_is_not_told(monkeypatch: pytest.MonkeyPatch) -> None:
    alike = SLOPES.copy()
    alike[:, 3:] = 0.3 * alike[:, :2]
    assert told(alike, monkeypatch) < 1e-12


def test_deviations_are_those_of_the_inverse_of_the_information() -> None:
    force_and_shear = SLOPES[:, 2:]
    assert shear._deviations(np.diag([2.0, 4.0, 5.0])) == pytest.approx([0.25, 0.2])
    unknown_place = shear._deviations(SLOPES[:, [2, 3, 4, 0, 1]])
    assert (unknown_place >= shear._deviations(force_and_shear)).all()
    assert unknown_place == pytest.approx([1.0 / 0.010, 1.0 / 0.002])
    assert np.isinf(shear._deviations(SLOPES[:4])).all()
