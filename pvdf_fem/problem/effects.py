"""Effects beyond the plain membrane: which a problem includes, and which it neglects."""

from __future__ import annotations

from dataclasses import dataclass

from pvdf_fem.film.effects import Charges
from pvdf_fem.film.electric.coupling import describe_coupling
from pvdf_fem.film.loads.load_spec import format_function_name
from pvdf_fem.film.loads.uneven_strain import describe_heat_effects
from pvdf_fem.film.loads.weight import describe_weight
from pvdf_fem.problem.problem import Problem
from pvdf_fem.problem.thickness_effect import describe_thickness_effect


@dataclass(frozen=True)
class Effects:
    """Sentences about effects on the charges, each with an estimate of its size."""

    included: tuple[str, ...]
    neglected: tuple[str, ...]


def describe_effects(problem: Problem, charges_pC: Charges = None) -> Effects:
    """Describe what a problem includes beyond the plain membrane, and what it neglects.

    Parameters
    ----------
    problem : Problem
        The problem.
    charges_pC : mapping, optional
        Charges by electrode, which sizes are compared with where they are known.

    Returns
    -------
    Effects
    """
    scene = problem.scene
    descriptions = [problem.film.bending_note]
    descriptions += describe_coupling(scene)
    descriptions += describe_thickness_effect(problem, charges_pC)
    descriptions += describe_heat_effects(scene, charges_pC)
    descriptions += describe_weight(scene)
    included = [text for is_included, text in descriptions if is_included]
    neglected = [text for is_included, text in descriptions if not is_included]
    if problem.pressure is not None:
        name = format_function_name(problem.pressure)
        included.insert(0, f"pressure: the function {name} in place of load.profile")
    return Effects(tuple(included), tuple(neglected))
