"""The interface of responses: charges of the electrodes as a smooth function of a touch.

Most responses describe one probe, whose touch is a row (4,) of x and y in mm, rotation in degrees
and force in N. A response may have several probes and further quantities in its rows.
"""

from __future__ import annotations

from collections.abc import Hashable
from functools import lru_cache
from typing import Protocol, runtime_checkable

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.scene.scene import Scene
from pvdf_fem.surrogate.touch_domain import Domain

#: Charges of the electrodes of the unloaded film in pC, and their estimated errors.
UnloadedCharges = tuple[tuple[float, ...], tuple[float, ...]]


@runtime_checkable
class ChargeFunction(Hashable, Protocol):
    """Charges of the electrodes as a smooth function of a touch."""

    @property
    def quantity_names(self) -> tuple[str, ...]:
        """Names of a touch's k quantities.

        `TOUCH_QUANTITIES` for one probe; for a list of probes these by key (``probe[1].x_mm``) for
        each of them; then any further quantities.
        """

    @property
    def is_fast(self) -> bool:
        """Whether thousands of evaluations take less than a second."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the electrodes."""

    @property
    def scene(self) -> Scene:
        """Film, electrodes and probe, with the values that `locate` fixes by default."""

    @property
    def domain(self) -> Domain:
        """Touches for which the charges are valid."""

    @property
    def error_bound(self) -> float:
        """Largest error of a charge, relative to the charge."""

    @property
    def unloaded_charges_pC(self) -> UnloadedCharges | None:
        """Charges of the unloaded film with their errors, if the function has them."""

    def evaluate(self, touches: Array) -> tuple[Array, Array]:
        """Return the charges of touches and their derivatives by the quantities.

        Parameters
        ----------
        touches : ndarray, shape (n, k)
            Rows of the quantities.

        Returns
        -------
        charges : ndarray, shape (n, electrodes)
            In pC.
        slopes : ndarray, shape (n, electrodes, k)
            In pC per unit of each quantity.
        """


@lru_cache(maxsize=8)
def count_probes(response: ChargeFunction) -> int:
    """Return the number of probes that load the film at once."""
    return sum(name.endswith("force_N") for name in response.quantity_names)


def find_rotation_period_deg(response: ChargeFunction) -> float:
    """Return the period of the charges by the first probe's rotation; 360 degrees for a disc."""
    return float(find_rotation_periods_deg(response)[0])


@lru_cache(maxsize=8)
def find_rotation_periods_deg(response: ChargeFunction) -> Array:
    """Return the period in degrees of the charges by each probe's rotation, (probes,)."""
    periods_deg = [load.probe.period_deg for load in response.scene.loaded_probes]
    if not periods_deg:
        return np.array([360.0])
    return np.array([period or 360.0 for period in periods_deg])


@lru_cache(maxsize=8)
def is_rotation_dependent(response: ChargeFunction) -> bool:
    """Return whether the charges depend on a probe's rotation, which those of discs do not."""
    loads = response.scene.loaded_probes
    return not loads or any(load.probe.period_deg > 0.0 for load in loads)


def compute_unloaded_charges_pC(scene: Scene, reading: str = "total") -> Array:
    """Compute the charges of the unloaded film.

    Parameters
    ----------
    scene : Scene
        Film, electrodes, probe and load.
    reading : str, optional
        With ``"change"`` the unloaded charges are necessary.

    Returns
    -------
    ndarray, shape (2, electrodes)
        Charges and their estimated errors in pC; NaN for a film without an unloaded equilibrium.

    Raises
    ------
    UnloadedFilmError
        If the film has no unloaded equilibrium and `reading` is ``"change"``.
    """
    from pvdf_fem.problem.problem import Problem
    from pvdf_fem.solver.adaptive import compute_unloaded_integrals  # imports gmsh

    integrals = compute_unloaded_integrals(Problem.from_scene(scene), required=reading == "change")
    d_pC_N = (scene.film.d31_pC_N, scene.film.d32_pC_N)
    return np.stack([integrals.charges(d_pC_N), integrals.charge_errors(d_pC_N)])
