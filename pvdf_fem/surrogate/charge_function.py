"""The interface of responses: charges of the electrodes as a smooth function of a touch.

Most responses describe one probe, whose touch is a row of four numbers: x and y in mm, the rotation
in degrees and the force in N. The touches of other responses have these numbers for each of several
probes, and further quantities.
"""

from __future__ import annotations

from collections.abc import Hashable
from functools import lru_cache
from typing import Protocol, runtime_checkable

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.scene.scene import Scene
from pvdf_fem.surrogate.touch_domain import Domain

#: Charges of the electrodes of the unloaded film, and their estimated errors, in pC.
UnloadedCharges = tuple[tuple[float, ...], tuple[float, ...]]


@runtime_checkable
class ChargeFunction(Hashable, Protocol):
    """Charges of the electrodes as a smooth function of a touch."""

    @property
    def quantity_names(self) -> tuple[str, ...]:
        """Names of the k columns of the array `touches` that `evaluate` accepts, in their order.

        For a single probe these are `TOUCH_QUANTITIES`. For several probes each name is a key, such
        as ``probe[1].x_mm``: four keys per probe, followed by the keys of further quantities.
        """

    @property
    def is_fast(self) -> bool:
        """Whether thousands of evaluations take less than a second."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the electrodes."""

    @property
    def scene(self) -> Scene:
        """Scene of the film, the electrodes and the probe.

        Its values are the defaults of quantities that `locate` does not find.
        """

    @property
    def domain(self) -> Domain:
        """Domain of the touches for which the charges are valid."""

    @property
    def error_bound(self) -> float:
        """Bound on the relative error of a charge."""

    @property
    def unloaded_charges_pC(self) -> UnloadedCharges | None:
        """Charges of the unloaded film and their estimated errors; None if they are not known."""

    def evaluate(self, touches: Array) -> tuple[Array, Array]:
        """Evaluate the charges of touches and their derivatives.

        Parameters
        ----------
        touches : ndarray, shape (n, k)
            A row for each touch, with the k quantities in the order of `quantity_names`.

        Returns
        -------
        charges : ndarray, shape (n, electrodes)
            Total charges in pC.
        slopes : ndarray, shape (n, electrodes, k)
            Derivatives with respect to the quantities, in pC per unit of each quantity.
        """


@lru_cache(maxsize=8)
def count_probes(response: ChargeFunction) -> int:
    """Count the probes that load the film at the same time."""
    return sum(name.endswith("force_N") for name in response.quantity_names)


def find_rotation_period_deg(response: ChargeFunction) -> float:
    """Return the smallest rotation in degrees that maps the first probe onto itself.

    It is 360 for a disc, and for a scene without a probe.
    """
    return float(find_rotation_periods_deg(response)[0])


@lru_cache(maxsize=8)
def find_rotation_periods_deg(response: ChargeFunction) -> Array:
    """Return the smallest rotation in degrees that maps each probe onto itself.

    Returns
    -------
    ndarray, shape (probes,)
        Rotations in degrees, 360 for a disc. A scene without a probe has a single value, 360.
    """
    periods_deg = [load.probe.period_deg for load in response.scene.loaded_probes]
    if not periods_deg:
        return np.array([360.0])
    return np.array([period or 360.0 for period in periods_deg])


@lru_cache(maxsize=8)
def is_rotation_dependent(response: ChargeFunction) -> bool:
    """Return whether the charges may depend on the rotation of a probe.

    True if a probe is not a disc, or if the scene of the response has no probe.
    """
    loads = response.scene.loaded_probes
    return not loads or any(load.probe.period_deg > 0.0 for load in loads)


def compute_unloaded_charges_pC(scene: Scene, reading: str = "total") -> Array:
    """Compute the charges of the unloaded film and their errors by a full solve.

    Parameters
    ----------
    scene : Scene
        Scene with the film and the electrodes; the probe has no effect.
    reading : {"total", "change"}, optional
        Meaning of the readings that the charges are for. Readings of the ``change`` require the
        unloaded charges; for ``total`` they may be missing.

    Returns
    -------
    ndarray, shape (2, electrodes)
        Charges, then their estimated errors, in pC; NaN if the film has no unloaded equilibrium.

    Raises
    ------
    UnloadedFilmError
        If the film has no unloaded equilibrium and `reading` is ``change``.
    """
    from pvdf_fem.problem.problem import Problem
    from pvdf_fem.solver.adaptive import compute_unloaded_integrals  # imports gmsh

    integrals = compute_unloaded_integrals(Problem.from_scene(scene), required=reading == "change")
    d_pC_N = (scene.film.d31_pC_N, scene.film.d32_pC_N)
    return np.stack([integrals.charges(d_pC_N), integrals.charge_errors(d_pC_N)])
