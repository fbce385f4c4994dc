"""The charges of a sensor as a function of the touch: place, rotation and force of one probe.

A response is a table of spline coefficients, so that an evaluation with its Jacobian takes some
ten microseconds. `build` makes it from few solves: the stress about the probe, for few places of
the rim and few forces (`probe_frame`, `rim_places`), gives the charges for every touch. How far
they are from those of full solves is measured on random touches, and stored with the response.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from pvdf_fem.response.uniform_spline import Axis, CubicSpline
from pvdf_fem.scene.scene import Scene
from pvdf_fem.touch.touch import all_within

Array = NDArray[np.float64]

# Charges are smooth in this power of the force, from where pretension counts to where it does not.
POWER = 1.0 / 6.0
# Relative excess over a domain that is rounding.
ROUNDING = 1e-9
# Of derivatives of order 0 and 1 by the force within those by x, y and rotation.
_VALUE_AND_SLOPES = np.array([0, 2, 4, 6, 1], dtype=np.intp)
FORMAT = "pvdf_fem response 1"


@dataclass(frozen=True)
class Domain:
    """Touches that a response is for.

    Attributes
    ----------
    reach_mm : float
        Largest distance of the probe from the film's centre.
    force_N : tuple of float
        Least and largest force.
    """

    reach_mm: float
    force_N: tuple[float, float]

    def scaled(self, force_N: Array) -> Array:
        """The force as an argument of Chebyshev polynomials, -1 to 1."""
        return self.scaled_with_rate(force_N)[0]

    def scaled_with_rate(self, force_N: Array) -> tuple[Array, Array]:
        """The same with its derivative by the force."""
        low, high = self._ends
        scaled = 2.0 / (high - low) * force_N**POWER
        return scaled - (low + high) / (high - low), POWER * scaled / force_N

    def force_nodes_N(self, count: int) -> Array:
        """The forces at Chebyshev's points, from the largest to the least."""
        low, high = self._ends
        at = np.cos((2 * np.arange(count) + 1) * np.pi / (2 * count))
        return (0.5 * (low + high) + 0.5 * (high - low) * at) ** (1.0 / POWER)

    @cached_property
    def _ends(self) -> tuple[float, float]:
        low, high = self.force_N
        return low**POWER, high**POWER

    def refuse_others(self, touches: Array) -> None:
        """Raise `ValueError` for touches (n, 4) outside."""
        more, less = 1.0 + ROUNDING, 1.0 - ROUNDING
        limits = more * self.reach_mm, less * self.force_N[0], more * self.force_N[1]
        if all_within(touches, *limits):
            return
        x, y, rotation, force = next(one for one in touches if not all_within(one[None], *limits))
        low, high = self.force_N
        raise ValueError(
            f"touches: x = {x:g} mm, y = {y:g} mm, {rotation:g} deg, {force:g} N is outside of the"
            f" response, {self.reach_mm:g} mm about the centre and {low:g} to {high:g} N; build one"
            " for a larger domain"
        )


@dataclass(frozen=True, eq=False)
class Response:
    """Charges of the electrodes by the touch.

    Attributes
    ----------
    names : tuple of str
        Electrodes.
    scene : Scene
        Film, electrodes and probe; the probe's place and the force do not matter.
    domain : Domain
    error_bound : float
        Error of a charge over |d31 X| + |d32 Y| that full solves at random touches did not reach.
    error_rms : float
        Root mean square of the errors at these.
    spline : CubicSpline
        Over x in mm, y in mm and rotation in degrees: coefficients in pC of Chebyshev polynomials
        of the force, by electrode, (polynomials electrodes,).
    """

    names: tuple[str, ...]
    scene: Scene
    domain: Domain
    error_bound: float
    error_rms: float
    spline: CubicSpline

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
        touches = np.asarray(touches, dtype=float).reshape(-1, 4)
        self.domain.refuse_others(touches)
        # (n, value and derivatives by place, polynomials, electrodes)
        by_place = self.spline.with_gradient(touches[:, :3])
        by_place = by_place.reshape(len(touches), 4, -1, len(self.names))
        scaled, rate = self.domain.scaled_with_rate(touches[:, 3])
        powers = scaled[:, None] ** self._orders
        # (n, value and derivative by force, polynomials)
        by_force = (powers @ self._polynomials).reshape(len(touches), 2, -1)
        by_force[:, 1] *= rate[:, None]
        # (n, value and derivatives by place times value and derivative by force, electrodes)
        both = np.matmul(by_force[:, None], by_place).reshape(len(touches), 8, -1)
        found = both.take(_VALUE_AND_SLOPES, axis=1)
        return found[:, 0], found[:, 1:].swapaxes(1, 2)

    def with_thickness(self, thickness_um: float) -> Response:
        """The response of a film of another thickness: without bending, F/h alone counts."""
        scene = self.scene.with_(**{"film.thickness_um": thickness_um})
        ratio = scene.film.thickness_um / self.scene.film.thickness_um
        low, high = self.domain.force_N
        domain = Domain(self.domain.reach_mm, (ratio * low, ratio * high))
        return replace(self, scene=scene, domain=domain)

    @cached_property
    def _count(self) -> int:
        return self.spline.coefficients.shape[-1] // len(self.names)

    @cached_property
    def _orders(self) -> Array:
        return np.arange(self._count, dtype=float)

    @cached_property
    def _polynomials(self) -> Array:
        """Powers times this, (powers, 2 polynomials), are Chebyshev's and their derivatives."""
        values = np.zeros((self._count, self._count))
        for k, unit in enumerate(np.eye(self._count)):
            powers = chebyshev.cheb2poly(unit)
            values[: len(powers), k] = powers
        slopes = np.zeros_like(values)
        slopes[:-1] = self._orders[1:, None] * values[1:]
        return np.concatenate([values, slopes], axis=1)

    def save(self, path: Path | str) -> None:
        """Write the response to a file, replacing it only when all is written."""
        path = Path(path)
        axes = [[a.start, a.step, a.count, a.periodic] for a in self.spline.axes]
        arrays: dict[str, Any] = {
            "format": FORMAT,
            "scene": self.scene.to_toml(),
            "domain": [self.domain.reach_mm, *self.domain.force_N],
            "errors": [self.error_bound, self.error_rms],
            "axes": axes,
            "coefficients": self.spline.coefficients,
        }
        part = path.with_name(path.name + ".part")
        with part.open("wb") as file:
            np.savez_compressed(file, **arrays)
        part.replace(path)

    @classmethod
    def load(cls, path: Path | str) -> Response:
        """Read a response from a file.

        Raises
        ------
        ValueError
            When the file is not a response of this version.
        """
        try:
            with np.load(path, allow_pickle=False) as file:
                arrays = {name: file[name] for name in file.files}
            if str(arrays["format"]) != FORMAT:
                raise KeyError
        except (KeyError, ValueError, AttributeError) as error:
            reason = "is not a response of this version; build it again"
            raise ValueError(f"{path}: {reason}") from error
        scene = Scene.parse(str(arrays["scene"]), str(path))
        reach, low, high = arrays["domain"].tolist()
        bound, rms = arrays["errors"].tolist()
        axes = tuple(Axis(s, h, int(n), bool(p)) for s, h, n, p in arrays["axes"].tolist())
        names = tuple(electrode.name for electrode in scene.electrode_list)
        spline = CubicSpline(axes, arrays["coefficients"])
        return cls(names, scene, Domain(reach, (low, high)), bound, rms, spline)
