"""The report on designs: its script, and its kinds with made-up charges in place of models."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from pvdf_fem.reporting.kind import Inputs
from pvdf_fem.reporting.solved import Solved
from pvdf_fem.reporting.task import key
from reports import __main__ as reports
from tests.helpers.touch_models import bumps


@pytest.fixture(scope="module")
def report():
    return reports.script("design")


def composed(item, inputs, monkeypatch):
    """The content of an item, with the rows of its tasks."""
    tasks = item.kind.tasks(inputs)
    module = sys.modules[type(tasks[0]).__module__]
    monkeypatch.setattr(module, "model_of", lambda scene, *_: bumps("circle").for_scene(scene))
    return item.kind.compose(inputs, Solved({key(task): task.run() for task in tasks}))


def test_every_task_of_every_size_is_of_designs_that_fit(report):
    for how in ({}, {"quick": True}, {"full": True}):
        _, needs = report.plan.needs(**how)
        assert all(need.tasks for need in needs)


@pytest.mark.parametrize("name", ["rings", "maps", "shapes"])
def test_figures_have_what_design_finds(report, name, monkeypatch):
    (item,) = (item for item in report.plan.items if item.name == name)
    inputs = Inputs(report.plan.scene, {}, quick=True)
    content = composed(item, inputs, monkeypatch)
    medians = content.frame.place_deviation_median_mm
    assert np.isfinite(medians).all()
    if name == "maps":
        assert len(content.figure.axes) == 4  # maps and their bars
        return
    drawn = np.concatenate([line.get_ydata() for line in content.figure.axes[0].lines])
    np.testing.assert_array_equal(drawn, medians)
    assert ("%" in content.claim) == (name == "rings")
