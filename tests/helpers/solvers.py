"""Newton's method as the fallback chain runs it, for tests of it alone."""

from __future__ import annotations

from pvdf_fem.arrays import Array
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.solver.nonlinear.deferred_newton import DeferredNewton, NewtonOptions
from pvdf_fem.solver.nonlinear.initial_guess import compute_initial_guess
from pvdf_fem.solver.nonlinear.newton import NewtonResult, run_newton


def solve_by_newton(
    equilibrium: Equilibrium, start: Array | None = None, options: NewtonOptions | None = None
) -> NewtonResult:
    """Run Newton's method with an exact line search, by default from a linear deflection."""
    options = NewtonOptions() if options is None else options
    variant = DeferredNewton(equilibrium, options, near=False)
    return run_newton(variant, compute_initial_guess(equilibrium) if start is None else start)
