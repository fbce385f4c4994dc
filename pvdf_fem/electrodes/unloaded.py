"""Stress integrals of the unloaded film, if its uniform stress gives them without a solve."""

from __future__ import annotations

import numpy as np

from pvdf_fem.electrodes.stress_integrals import StressIntegrals
from pvdf_fem.problem.outputs import compute_output_areas
from pvdf_fem.problem.problem import Problem


def compute_uniform_integrals(problem: Problem) -> StressIntegrals | None:
    """Compute the stress integrals of a problem's unloaded film from its uniform stress.

    On a flat film of uniform stress, every observable gives area times stress.

    Parameters
    ----------
    problem : Problem
        The problem of the loaded film.

    Returns
    -------
    StressIntegrals or None
        With zero errors. None if the unloaded film has no known uniform stress, so that it must be
        solved.
    """
    stress = problem.unloaded_stress
    if stress is None:
        return None
    areas = compute_output_areas(problem.unloaded_outputs)
    values = areas[:, None] * stress
    return StressIntegrals(values, np.zeros_like(values))
