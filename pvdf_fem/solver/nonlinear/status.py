"""The status of a solve, and advice on what to change if there is no result."""

from __future__ import annotations

from enum import StrEnum


class NotConvergedError(RuntimeError):
    """Results were requested of a solve without any; the text says why and what to change.

    Examples
    --------
    >>> try:
    ...     solve(Scene(film={"temperature_change_K": 10.0})).charges_pC
    ... except NotConvergedError as error:
    ...     print(error)
    """


class Status(StrEnum):
    """How a solve ended.

    Examples
    --------
    >>> solve(Scene.example("triangle")).status == Status.CONVERGED
    >>> print(Status.SLACK.advice)
    """

    CONVERGED = "converged"
    MAX_ITERATIONS = "max_iterations"
    SINGULAR = "singular_tangent"
    UNSTABLE = "unstable"
    UNBALANCED = "unbalanced"
    TOLERANCE = "tolerance_not_reached"
    SLACK = "slack"
    MESH_FAILED = "mesh_failed"
    RIM = "tip_meets_rim"

    @property
    def advice(self) -> str:
        """Explanation of the status, with what to change in the scene unless it converged."""
        return ADVICE[self]


_TENSION = "(lower film.temperature_change_K, or raise film.pretension_N_m)"
ADVICE = {
    Status.CONVERGED: "every result is within the tolerance",
    Status.MAX_ITERATIONS: "Newton's method found no equilibrium; lower load.force_N, give the film"
    f" more tension {_TENSION}, or replace a follower pressure, which may inflate the film or turn"
    ' it over, by a pressure along z (load.kind = "dead")',
    Status.SINGULAR: "the tangent is singular, since the film has no tension; give it tension"
    f" {_TENSION}",
    Status.UNBALANCED: "the forces on the film do not balance to 1e-6 of the load, because of"
    " rounding in a film of extreme proportions; make the probe larger",
    Status.TOLERANCE: "a charge misses the tolerance; raise numerics.tolerance",
    Status.SLACK: "heating or compression has made the film so large that the load does not pull it"
    " taut, and it folds more finely than any mesh allows; raise load.force_N, lower"
    " film.temperature_change_K or raise film.pretension_N_m",
    Status.MESH_FAILED: "gmsh could not mesh the scene; move or resize the probe slightly",
    Status.RIM: "the tip presses the film onto the clamped rim; move the probe inwards, or lower"
    " force or depth",
    Status.UNSTABLE: "every equilibrium found is unstable: the film is in compression, which a"
    ' membrane cannot carry; let it wrinkle (film.compression = "tension-field") or give it tension'
    f" {_TENSION}",
}
