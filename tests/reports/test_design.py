"""The report on designs: its kinds with made-up charges in place of models."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from pvdf_fem.report.kind import Inputs
from pvdf_fem.report.results import ReportResults
from pvdf_fem.report.task import compute_key
from reports.__main__ import load_report
from tests.helpers.bump_response import make_bump_response


@pytest.mark.parametrize("name", ["rings", "maps", "shapes"])
def test_figures_have_what_design_finds(name, monkeypatch):
    plan = load_report("design").plan
    (item,) = (item for item in plan.items if item.name == name)
    inputs = Inputs(plan.scene, {}, quick=True)
    tasks = item.kind.list_tasks(inputs)
    module = sys.modules[type(tasks[0]).__module__]
    monkeypatch.setattr(
        module,
        "build_cached_response",
        lambda scene, *_: make_bump_response("circle").for_scene(scene),
    )
    content = item.kind.compose(
        inputs, ReportResults({compute_key(task): task.run() for task in tasks})
    )
    medians = content.frame.place_deviation_median_mm
    assert np.isfinite(medians).all()
    if name == "maps":
        assert len(content.figure.axes) == 4  # maps and their bars
        return
    drawn = np.concatenate([line.get_ydata() for line in content.figure.axes[0].lines])
    np.testing.assert_array_equal(drawn, medians)
    assert ("%" in content.claim) == (name == "rings")
