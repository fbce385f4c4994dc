"""Fits of what the charges lack, and stresses in the axes of the tilted film."""

from __future__ import annotations

import numpy as np
import pytest

from reports.chapters.force_and_angle.rectangle import asymmetry_pC
from reports.chapters.unexplained import FACTOR, LARGER, Fit, in_tilted_axes_pC, larger
from reports.common.comparison import Comparison, bias, swings_pC
from reports.common.thesis_data import Thesis
from reports.common.thesis_scene import thesis_scene

DATA = Thesis.read()


def test_a_fit_finds_both_causes() -> None:
    probe = np.array([0.3, -0.2, 1.1, 0.7])
    lacking = 0.8 + 0.5 * probe + np.array([0.01, -0.01, 0.01, -0.01])
    both = Fit.of("both", {FACTOR: np.ones(4), LARGER: probe}, lacking)
    assert both.values == pytest.approx({FACTOR: 0.8, LARGER: 0.5}, abs=0.02)
    assert both.rms_percent < 0.011
    assert Fit.of("nothing", {}, lacking).rms_percent == pytest.approx(np.sqrt(np.mean(lacking**2)))


def test_a_larger_probe_keeps_its_force_and_place() -> None:
    charge = next(c for c in DATA.charges if c.case == "s312_1")
    probe = larger(charge).single_probe
    assert probe is not None
    assert 1e6 * probe.outline.area == pytest.approx(np.sqrt(3.0) / 4.0 * 7.5**2)
    assert (probe.x_mm, probe.y_mm) == (charge.x_mm, charge.y_mm)
    assert larger(charge).load.force_N == 1.0


def test_a_flat_film_has_the_same_stress_in_both_axes() -> None:
    charges = in_tilted_axes_pC(thesis_scene("4", "tri7").with_(probe=None))
    assert charges == pytest.approx(dict.fromkeys("ABCD", 48.0), rel=1e-9)


def test_the_sign_of_the_differences_is_told() -> None:
    rows = [c for c in DATA.from_("Table 4.1") if c.electrode == "A"]
    below = [Comparison(c, "converged", 0.99 * c.charge_pC, 0.0, 0.0) for c in rows]
    assert f"{len(rows)} of {len(rows)} are negative" in bias(below)
    assert "−1.00 %" in bias(below)
    theirs, ours = swings_pC(below)
    assert ours == pytest.approx(0.99 * theirs)
    assert bias([]) == ""


def test_table_4_1_obeys_its_symmetry() -> None:
    assert asymmetry_pC(DATA) == pytest.approx(1.6794, abs=1e-4)
    with pytest.raises(KeyError):
        asymmetry_pC(DATA.quick())
