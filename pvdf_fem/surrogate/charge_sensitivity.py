"""Derivatives of the charges of a response with respect to parameters of the film.

The derivatives are solved at some random touches and fitted by quantities that the response
evaluates anyway: the changes of the charges and their derivatives with respect to the touch.

The tension in a membrane is E h n(N/(E h), F/(E h)), with Young's modulus E, thickness h,
pretension N and force F. So its derivatives with respect to these obey E ∂/∂E + N ∂/∂N + F ∂/∂F = 1
and the like, and those of the charges are nearly combinations of a charge and of its derivative
with respect to the force. On discs of 45 mm, six-fold cross-validation of 48 touches gives errors
of 1 % for moduli and thickness, 10 % for pretensions, 13 % for Poisson's ratio, and 7 % for d31 and
d32, as fractions of the root mean square of the derivative."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.scene.changes import get_number
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.nonlinear.status import NotConvergedError, Status
from pvdf_fem.surrogate.response_file import FileArray
from pvdf_fem.surrogate.touch_domain import (
    Domain,
    TouchColumn,
    apply_touch,
    draw_touches,
)

if TYPE_CHECKING:
    from pvdf_fem.progress import TaskRunner
    from pvdf_fem.solver.solution import Solution

#: Number of random touches at which derivatives are solved, in 0.13 s of CPU time each.
SOLVED_TOUCHES = 48
SEED = 1  #: Seed of these touches, which differ from those that measure the error of a response.
#: Tolerance of the solves; errors of the fit are larger.
TOLERANCE = 3e-3
#: Ridge parameter of the fit, as a fraction of the root mean square of the features.
RIDGE = 0.01
#: Relative step of the central differences of the unloaded film.
UNLOADED_STEP = 1e-4
#: Coefficients of the charges: their derivatives are the stress integrals X and Y.
COEFFICIENT_KEYS = ("film.d31_pC_N", "film.d32_pC_N")
SHARED_FEATURES = 9  #: Number of features whose coefficients all electrodes share.


@dataclass(frozen=True, eq=False)
class ChargeSensitivities:
    """Derivatives of charges with respect to parameters of the film, as a function of the touch."""

    keys: tuple[str, ...]  #: Keys of the parameters in the scene.
    domain: Domain  #: Domain of the response, which scales the features.
    #: Charges of the unloaded film in pC, or zeros if it has no equilibrium, shape (electrodes,).
    unloaded_pC: FileArray
    #: Derivatives of the charges of the unloaded film, shape (electrodes, keys).
    unloaded_slopes: FileArray
    #: Coefficients of the features (`_compute_features`), shape (electrodes, features, keys).
    coefficients: FileArray

    def evaluate(self, touches: Array, charges_pC: Array, slopes: Array) -> Array:
        """Compute derivatives of the changes of the charges, without those of the unloaded film.

        Parameters
        ----------
        touches : ndarray, shape (n, 4)
            Rows of x and y in mm, rotation in degrees and force in N, in the axes of the film.
        charges_pC : ndarray, shape (n, electrodes)
            Total charges of these touches in pC.
        slopes : ndarray, shape (n, electrodes, 4)
            Derivatives of the charges with respect to the touch.

        Returns
        -------
        ndarray, shape (n, electrodes, keys)
            Derivatives in pC per unit of each key.
        """
        features = _compute_features(self.domain, touches, charges_pC - self.unloaded_pC, slopes)
        return np.asarray(np.einsum("nef,efk->nek", features, self.coefficients))

    def select(self, keys: Sequence[str]) -> ChargeSensitivities:
        """Return the derivatives with respect to some of the keys, in their order."""
        columns = [self.keys.index(key) for key in keys]
        return ChargeSensitivities(
            tuple(keys),
            self.domain,
            self.unloaded_pC,
            unloaded_slopes=self.unloaded_slopes[:, columns],
            coefficients=self.coefficients[:, :, columns],
        )


def _compute_features(domain: Domain, touches: Array, changes_pC: Array, slopes: Array) -> Array:
    """Compute the quantities of which derivatives are linear combinations.

    Parameters
    ----------
    domain : Domain
        Domain, which scales distances and forces.
    touches : ndarray, shape (n, 4)
        Rows of x and y in mm, rotation in degrees and force in N.
    changes_pC : ndarray, shape (n, electrodes)
        Changes q of the charges by the touches.
    slopes : ndarray, shape (n, electrodes, 4)
        Derivatives of the charges with respect to the touch.

    Returns
    -------
    ndarray, shape (n, electrodes, features)
        First q, F ∂q/∂F and x ∂q/∂x + y ∂q/∂y, each times 1, the logarithm of the force and the
        squared distance from the centre. Then the derivatives x ∂q/∂x - y ∂q/∂y,
        x ∂q/∂y + y ∂q/∂x, ∂q/∂x and ∂q/∂y, which distinguish X from Y.
    """
    x = touches[:, TouchColumn.X, None]
    y = touches[:, TouchColumn.Y, None]
    force = touches[:, TouchColumn.FORCE, None]
    by_x = slopes[:, :, TouchColumn.X]
    by_y = slopes[:, :, TouchColumn.Y]
    reach = domain.reach_mm
    isotropic = (changes_pC, force * slopes[:, :, TouchColumn.FORCE], x * by_x + y * by_y)
    log_force = np.log(force) - 0.5 * sum(domain.log_force)
    square = (x * x + y * y) / reach**2
    features = []
    for feature in isotropic:
        features += [feature, log_force * feature, square * feature]
    features += [x * by_x - y * by_y, x * by_y + y * by_x, reach * by_x, reach * by_y]
    return np.stack(features, axis=-1)


def list_film_keys(scene: Scene) -> tuple[str, ...]:
    """List the parameters of the film in a scene's ``[calibration]``."""
    keys = scene.calibration.keys if scene.calibration else ()
    return tuple(key for key in keys if key.startswith("film."))


def fit_sensitivities(
    scene: Scene, domain: Domain, keys: Sequence[str], evaluate: Any, runner: TaskRunner
) -> ChargeSensitivities:
    """Solve the derivatives of the charges at random touches of a domain, and fit them.

    Parameters
    ----------
    scene : Scene
        Scene with a single probe.
    domain : Domain
        Domain of the touches.
    keys : sequence of str
        Keys of the film, of those that `list_parameters` lists.
    evaluate : callable
        `Response.evaluate` of the response for this scene.
    runner : TaskRunner
        Runner of the solves on several processes.

    Raises
    ------
    ValueError
        If charges have no derivative with respect to a key.
    NotConvergedError
        If more than half of the touches cannot be solved.
    """
    require_derivatives(scene, keys)
    unloaded = solve_unloaded_film(scene, keys)
    drawn = draw_touches(domain, SOLVED_TOUCHES, SEED)
    tasks = [(solve_slopes, scene, touch, tuple(keys)) for touch in drawn]
    results = [*runner.run(tasks)]
    is_solved = np.array([not isinstance(result, str) for result in results])
    if 2 * is_solved.sum() < len(drawn):
        reason = next(result for result in results if isinstance(result, str))
        raise NotConvergedError(f"derivatives with respect to {', '.join(keys)}: {reason}")
    touches = drawn[is_solved]
    solved = np.stack([result for result in results if not isinstance(result, str)])
    charges_pC, slopes = evaluate(touches)
    changes_pC = charges_pC - unloaded[:, 0]
    features = _compute_features(domain, touches, changes_pC, slopes)
    sizes = np.abs(changes_pC).max(axis=1)[:, None, None]
    coefficients = _fit_coefficients(features / sizes, (solved - unloaded[:, 1:]) / sizes)
    return ChargeSensitivities(
        tuple(keys),
        domain,
        unloaded_pC=unloaded[:, 0],
        unloaded_slopes=unloaded[:, 1:],
        coefficients=coefficients,
    )


def require_derivatives(scene: Scene, keys: Sequence[str]) -> None:
    """Raise `ValueError` if charges have no derivative with respect to keys of the film."""
    from pvdf_fem.problem.problem import Problem  # imports scikit-fem
    from pvdf_fem.solver.sensitivity.parameters import explain_missing_derivative, list_parameters

    problem = Problem.from_scene(scene)
    known = list_parameters(problem)
    errors = []
    for key in keys:
        if key not in known:
            reason = explain_missing_derivative(problem, key)
            advice = "remove it from [calibration], or leave out the errors of the calibration"
            errors.append(f"calibration.keys = {key}: {reason}; {advice}")
    if errors:
        raise ValueError("\n".join(errors))


def _fit_coefficients(features: Array, derivatives: Array) -> Array:
    """Fit derivatives by features: the first with coefficients that all electrodes share.

    Parameters
    ----------
    features : ndarray, shape (n, electrodes, features)
        Weighted features. All have coefficients for each electrode, too, except for those that are
        multiplied by the force or the distance.
    derivatives : ndarray, shape (n, electrodes, keys)
        Weighted derivatives.

    Returns
    -------
    ndarray, shape (electrodes, features, keys)
        Sums of shared and own coefficients.
    """
    count, electrodes, width = features.shape
    own = [0, 3, 6, *range(SHARED_FEATURES, width)]
    design = np.zeros((count, electrodes, SHARED_FEATURES + electrodes * len(own)))
    design[:, :, :SHARED_FEATURES] = features[:, :, :SHARED_FEATURES]
    for electrode in range(electrodes):
        first = SHARED_FEATURES + electrode * len(own)
        design[:, electrode, first : first + len(own)] = features[:, electrode, own]
    rows = design.reshape(count * electrodes, -1)
    scale = np.sqrt(np.square(rows).mean(axis=0))
    scale[scale == 0.0] = 1.0
    ridge = RIDGE * np.sqrt(len(rows)) * np.eye(rows.shape[1])
    right = derivatives.reshape(count * electrodes, -1)
    padded = np.concatenate([right, np.zeros((len(ridge), right.shape[1]))])
    solution = np.linalg.lstsq(np.concatenate([rows / scale, ridge]), padded)[0] / scale[:, None]
    coefficients = np.zeros((electrodes, width, right.shape[1]))
    coefficients[:, :SHARED_FEATURES] = solution[:SHARED_FEATURES]
    for electrode in range(electrodes):
        first = SHARED_FEATURES + electrode * len(own)
        coefficients[electrode, own] += solution[first : first + len(own)]
    return coefficients


def solve_slopes(scene: Scene, touch: Array, keys: Sequence[str]) -> Array | str:
    """Solve a touch, and return the derivatives of the charges with respect to keys of the film.

    Parameters
    ----------
    scene : Scene
        Scene with a single probe.
    touch : ndarray, shape (4,)
        Position x and y in mm, rotation in degrees and force in N.
    keys : sequence of str
        Keys of the film.

    Returns
    -------
    ndarray, shape (electrodes, keys), or str
        Derivatives in pC per unit of each key, or the reason as a text if the solve did not
        converge.
    """
    from pvdf_fem.problem.problem import Problem  # imports gmsh
    from pvdf_fem.solver.adaptive import solve_outputs

    solution = solve_outputs(Problem.from_scene(apply_touch(scene, touch, TOLERANCE)))
    if solution.status is not Status.CONVERGED:
        return solution.reason
    return differentiate_charges(solution, keys)


def differentiate_charges(solution: Solution, keys: Sequence[str]) -> Array:
    """Compute the derivatives of the charges of a solution with respect to keys of the film.

    Parameters
    ----------
    solution : Solution
        Converged solution.
    keys : sequence of str
        Keys of the film.

    Returns
    -------
    ndarray, shape (electrodes, keys)
        Derivatives in pC per unit of each key.
    """
    from pvdf_fem.solver.sensitivity.rates import differentiate_stress_integrals

    film = solution.scene.film
    d_pC_N = np.array([film.d31_pC_N, film.d32_pC_N])
    integrals = solution.discrete.stress_integrals.values
    mechanical = [key for key in keys if key not in COEFFICIENT_KEYS]
    rates = differentiate_stress_integrals(solution, mechanical) @ d_pC_N
    by_key = dict(zip(mechanical, rates, strict=True))
    by_key |= dict(zip(COEFFICIENT_KEYS, integrals.T, strict=True))
    return np.stack([by_key[key] for key in keys], axis=-1)


def solve_unloaded_film(scene: Scene, keys: Sequence[str]) -> Array:
    """Solve the charges of the unloaded film and their derivatives, by central differences.

    Returns
    -------
    ndarray, shape (electrodes, 1 + keys)
        Charges in pC, then their derivatives with respect to the keys. Zeros if the film has no
        unloaded equilibrium.
    """
    from pvdf_fem.problem.problem import Problem  # imports gmsh
    from pvdf_fem.solver.adaptive import compute_unloaded_integrals

    def compute_charges(changed: Scene) -> Array:
        """Compute the charges of the unloaded film of a changed scene; NaN if there are none."""
        integrals = compute_unloaded_integrals(Problem.from_scene(changed), required=False)
        film = changed.film
        return np.asarray(integrals.values @ np.array([film.d31_pC_N, film.d32_pC_N]))

    columns = [compute_charges(scene)]
    for key in keys:
        value = get_number(scene, key)
        step = UNLOADED_STEP * (abs(value) if value else 1.0)
        higher = compute_charges(scene.with_(**{key: value + step}))
        lower = compute_charges(scene.with_(**{key: value - step}))
        columns.append((higher - lower) / (2.0 * step))
    unloaded = np.stack(columns, axis=-1)
    if not np.isfinite(unloaded).all():
        return np.zeros_like(unloaded)
    return unloaded
