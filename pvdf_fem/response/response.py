"""The charges of a sensor as a function of the touch: place, rotation and force of one probe.

A response is a table of spline coefficients, so that an evaluation with its Jacobian takes some ten
microseconds. `build.build_response` makes it from a few dozen solves, measures its error against
full solves of random touches, and stores the error with it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.response.model import FORCE, QUANTITIES, Domain, all_within
from pvdf_fem.response.response_file import Contents, read, write
from pvdf_fem.response.uniform_spline import UniformSpline
from pvdf_fem.scene.scene import Scene

#: Charges are smooth in this power of the force, both where the pretension carries it and where the
#: tension that it makes itself does.
POWER = 1.0 / 6.0
#: Share by which a touch may exceed the domain, as rounding makes it.
ROUNDING = 1e-9
# Rows of the products (value and derivatives by x, y, rotation) x (value and derivative by force):
# the value, and the derivatives by x, y, rotation and force.
_VALUE_AND_SLOPES: Indices = np.array([0, 2, 4, 6, 1])


def scaled_force(domain: Domain, force_N: Array) -> tuple[Array, Array]:
    """The argument of Chebyshev polynomials, -1 to 1 over a domain's forces, and its derivative."""
    low, high = (limit**POWER for limit in domain.force_N)
    scaled = 2.0 / (high - low) * force_N**POWER
    return scaled - (low + high) / (high - low), POWER * scaled / force_N


def force_nodes_N(domain: Domain, count: int) -> Array:
    """Forces at the Chebyshev points of a domain, from the largest to the least."""
    low, high = (limit**POWER for limit in domain.force_N)
    nodes = np.cos((2 * np.arange(count) + 1) * np.pi / (2 * count))
    return (0.5 * (low + high) + 0.5 * (high - low) * nodes) ** (1.0 / POWER)


def refuse_outside(domain: Domain, touches: Array) -> None:
    """Raise `ValueError` for touches (n, 4) that are not finite, or outside of a domain."""
    low, high = domain.force_N
    more, less = 1.0 + ROUNDING, 1.0 - ROUNDING
    limits = more * domain.reach_mm, less * low, more * high
    if all_within(touches, *limits):
        return
    x, y, rotation, force = next(row for row in touches if not all_within(row[None], *limits))
    raise ValueError(
        f"touches: x = {x:g} mm, y = {y:g} mm, {rotation:g} deg, {force:g} N is outside of the"
        f" response, {domain.reach_mm:g} mm about the centre and {low:g} to {high:g} N; build one"
        " for a larger domain"
    )


@dataclass(frozen=True, eq=False)
class Response:
    """Charges of the electrodes by the touch.

    Attributes
    ----------
    names : tuple of str
        Names of the electrodes.
    scene : Scene
        Film, electrodes and probe; the probe's place and the force do not matter.
    domain : Domain
        Touches that it holds for.
    error_bound : float
        Bound on the error of a charge over |d31 X| + |d32 Y|: five times the largest error at the
        random touches whose full solves it was compared with.
    error_rms : float
        Root mean square of the errors at these touches.
    spline : UniformSpline
        Over x in mm, y in mm and rotation in degrees: coefficients in pC of Chebyshev polynomials
        of the force, for each of them by electrode, (polynomials electrodes,).
    """

    names: tuple[str, ...]
    scene: Scene
    domain: Domain
    error_bound: float
    error_rms: float
    spline: UniformSpline

    def evaluate(self, touches: ArrayLike) -> tuple[Array, Array]:
        """Charges and their derivatives.

        Parameters
        ----------
        touches : array_like, shape (n, 4)
            x in mm, y in mm, rotation in degrees, force in N.

        Returns
        -------
        charges_pC : ndarray, shape (n, electrodes)
        jacobian : ndarray, shape (n, electrodes, 4)
            In pC/mm, pC/mm, pC/deg and pC/N.

        Raises
        ------
        ValueError
            For a touch outside of the domain.
        """
        touches = np.asarray(touches, dtype=float).reshape(-1, len(QUANTITIES))
        refuse_outside(self.domain, touches)
        # (n, value and derivatives by place, polynomials, electrodes)
        by_place = self.spline.with_gradient(touches[:, :FORCE])
        by_place = by_place.reshape(len(touches), 4, -1, len(self.names))
        scaled, rate = scaled_force(self.domain, touches[:, FORCE])
        powers = scaled[:, None] ** self._orders
        # (n, value and derivative by force, polynomials)
        by_force = (powers @ self._polynomials).reshape(len(touches), 2, -1)
        by_force[:, 1] *= rate[:, None]
        # (n, value and derivatives by place x value and derivative by force, electrodes)
        products = np.matmul(by_force[:, None], by_place).reshape(len(touches), 8, -1)
        charges_and_slopes = products.take(_VALUE_AND_SLOPES, axis=1)
        return charges_and_slopes[:, 0], charges_and_slopes[:, 1:].swapaxes(1, 2)

    def with_thickness(self, thickness_um: float) -> Response:
        """The response of a film of another thickness; without bending F/h alone counts."""
        scene = self.scene.with_(**{"film.thickness_um": thickness_um})
        ratio = scene.film.thickness_um / self.scene.film.thickness_um
        if (tension := scene.film.pretension_N_m) is not None:  # the stress at rest stays
            scene = scene.with_(**{"film.pretension_N_m": ratio * np.array(tension)})
        low, high = self.domain.force_N
        domain = Domain(self.domain.reach_mm, (ratio * low, ratio * high))
        return replace(self, scene=scene, domain=domain)

    @cached_property
    def _polynomial_count(self) -> int:
        return self.spline.coefficients.shape[-1] // len(self.names)

    @cached_property
    def _orders(self) -> Array:
        return np.arange(self._polynomial_count, dtype=float)

    @cached_property
    def _polynomials(self) -> Array:
        """Coefficients (powers, 2 polynomials) of Chebyshev polynomials and their derivatives."""
        count = self._polynomial_count
        values = np.zeros((count, count))
        for k in range(count):
            values[: k + 1, k] = chebyshev.cheb2poly(np.eye(count)[k, : k + 1])
        slopes = np.zeros_like(values)
        slopes[:-1] = self._orders[1:, None] * values[1:]
        return np.concatenate([values, slopes], axis=1)

    def save(self, path: Path | str) -> None:
        """Write the response to a file, which replaces an older one only when it is complete.

        Raises `FileError` when the file cannot be written.
        """
        coefficients = self.spline.coefficients
        contents = Contents(
            scene=self.scene,
            domain=self.domain,
            error_bound=self.error_bound,
            error_rms=self.error_rms,
            axes=self.spline.axes,
            polynomials=self._polynomial_count,
            dtype=coefficients.dtype.newbyteorder("<").str,
        )
        write(Path(path), contents, coefficients)

    @classmethod
    def load(cls, path: Path | str) -> Response:
        """Read a response from a file.

        Raises
        ------
        FileError
            When the file cannot be read; as `ResponseError`, when it holds no sound response.
        """
        file, coefficients = read(Path(path))
        names = tuple(electrode.name for electrode in file.scene.electrode_list)
        spline = UniformSpline(file.axes, coefficients)
        return cls(names, file.scene, file.domain, file.error_bound, file.error_rms, spline)
