"""Electrode charges as a smooth function of the probe's position.

Charges are solved on rings around the film's centre, and interpolated by a quintic polyharmonic
spline (Duchon 1977) through the logarithms of the charges. The two outermost rings are half as far
apart as the others, since the error of the spline is largest at its boundary. The rings keep the
symmetry of probe and film: positions that are images of each other under a rotation or reflection
share one solve. A disc needs one solve for each ring, a triangle one for a sixth of the points. The
error of the spline is estimated by cross-validation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Self

import numpy as np
from scipy.interpolate import RBFInterpolator

from pvdf_fem.arrays import Array, Mask
from pvdf_fem.report.kind import make_scenes_at_positions
from pvdf_fem.scene.scene import Scene
from pvdf_fem.surrogate.charge_spline import estimate_pressed_outline
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, Domain, TouchColumn

#: Pitch divided by the square root of the sum of the areas of probe and smallest electrode. The
#: relative error of the interpolated charges of the thesis's sensor is then below 2e-3.
RELATIVE_PITCH = 0.36
MAX_LOGARITHM = 300.0  #: Limit of logarithms, against overflow far outside of the points.
MAX_MISSING_FRACTION = 0.1  #: Maximum fraction of the points without charges.
FOLDS = 11  #: Number of folds of the cross-validation.
RELATIVE_STEP = 1e-5  #: Step of central differences as a fraction of the map's radius.


def choose_pitch_mm(scene: Scene) -> float:
    """Return the distance in mm between neighbouring points that resolves a scene's charges."""
    smallest = min(electrode.outline.area for electrode in scene.electrode_list)
    pressed = 0.0
    if scene.single_probe:
        pressed = estimate_pressed_outline(scene, scene.load.force_N).area
    return 1e3 * RELATIVE_PITCH * math.sqrt(smallest + pressed)


def make_ring_points(reach_mm: float, pitch_mm: float, first_deg: float) -> Array:
    """Return points on rings around the film's centre.

    The number of points on a ring is a multiple of twelve, so that rings are invariant under
    rotations by 120 and 90 degrees.

    Parameters
    ----------
    reach_mm : float
        Radius of the outermost ring in mm.
    pitch_mm : float
        Maximum distance between neighbouring points in mm.
    first_deg : float
        Direction of the first point on each ring in degrees.

    Returns
    -------
    ndarray, shape (n, 2)
        Coordinates in mm, the centre first.
    """
    count = max(1, math.ceil(reach_mm / pitch_mm - 1e-9))
    inner = np.arange(1, count) * (reach_mm / count)
    radii = [*inner, reach_mm * (1.0 - 0.5 / count), reach_mm]
    rings = [np.zeros((1, 2))]
    for radius in radii:
        number = 12 * max(1, math.ceil(2.0 * math.pi * radius / (12.0 * pitch_mm)))
        angles = math.radians(first_deg) + 2.0 * math.pi * np.arange(number) / number
        rings.append(radius * np.column_stack([np.cos(angles), np.sin(angles)]))
    return np.concatenate(rings).round(9)


@dataclass(frozen=True)
class MapPoints:
    """The positions of the probe at which the charges of a map are solved.

    Parameters
    ----------
    scene : Scene
        A scene with one probe, whose position does not matter.
    reach_mm : float
        Radius of the map in mm.
    pitch_mm : float, optional
        Maximum distance between neighbouring points in mm. Default: `choose_pitch_mm(scene)`.
    """

    scene: Scene
    reach_mm: float
    pitch_mm: float | None = None

    @cached_property
    def points_mm(self) -> Array:
        """Coordinates in mm, an array of shape (n, 2)."""
        pitch = choose_pitch_mm(self.scene) if self.pitch_mm is None else self.pitch_mm
        probe = self.scene.single_probe
        rotation_deg = probe.rotation_deg if probe else 0.0
        return make_ring_points(self.reach_mm, pitch, 90.0 + rotation_deg)

    @cached_property
    def scenes(self) -> list[Scene]:
        """Scenes to solve, in the order of the points.

        Raises
        ------
        SceneError
            If the scene does not have exactly one probe, or if the probe does not fit.
        """
        return make_scenes_at_positions(self.scene, self.points_mm)


@dataclass(frozen=True, eq=False)
class ChargeMap:
    """Interpolated charges: a `ChargeFunction` of touches with a fixed force and rotation.

    Parameters
    ----------
    scene : Scene
        The scene, in which the position of the probe does not matter.
    domain : Domain
        Touches for which the charges are valid.
    spline : RBFInterpolator
        Function of positions in mm, shape (n, 2), that returns charges in pC or their logarithms,
        shape (n, electrodes).
    is_logarithmic : ndarray of bool, shape (electrodes,)
        Whether a value is the logarithm of the charge in pC, or the charge itself.
    error_bound : float
        Root mean square of the relative errors of cross-validation.
    """

    quantity_names: ClassVar[tuple[str, ...]] = TOUCH_QUANTITIES
    is_fast: ClassVar[bool] = True
    unloaded_charges_pC: ClassVar[None] = None
    scene: Scene
    domain: Domain
    spline: RBFInterpolator
    is_logarithmic: Mask
    error_bound: float

    @classmethod
    def fit(cls, points: MapPoints, charges_pC: Array) -> Self:
        """Fit a map to the charges at its points.

        Parameters
        ----------
        points : MapPoints
            The scene and the positions of its probe.
        charges_pC : ndarray, shape (n, electrodes)
            Charges in pC, NaN where a solve failed. If all charges of an electrode are positive,
            their logarithms are interpolated.

        Returns
        -------
        ChargeMap

        Raises
        ------
        ValueError
            If more than `MAX_MISSING_FRACTION` of the points have no charges.
        """
        is_known = np.isfinite(charges_pC).all(axis=1)
        if is_known.mean() < 1.0 - MAX_MISSING_FRACTION:
            reason = f"{(~is_known).sum()} of the {is_known.size} points have no charges"
            raise ValueError(f"{reason}, more than {MAX_MISSING_FRACTION:.0%}")
        points_mm = points.points_mm[is_known]
        charges = charges_pC[is_known]
        is_logarithmic = np.asarray((charges > 0.0).all(axis=0))
        values = np.where(is_logarithmic, np.log(np.where(is_logarithmic, charges, 1.0)), charges)
        # the error of a logarithm is already a relative error
        scale = np.where(is_logarithmic, 1.0, np.abs(charges).max(axis=0))
        is_inner = np.linalg.norm(points_mm, axis=1) < points.reach_mm - 1e-6
        errors = _cross_validate_spline(points_mm, values)[is_inner] / scale
        force_N = points.scene.load.force_N
        return cls(
            # a map has charges on the film, which do not depend on amplifiers, stage and
            # calibration
            scene=points.scene.model_copy(
                update={"readout": None, "stage": None, "calibration": None}
            ),
            domain=Domain(points.reach_mm, (force_N, force_N)),
            spline=_fit_spline(points_mm, values),
            is_logarithmic=is_logarithmic,
            error_bound=float(np.sqrt(np.mean(errors**2))),
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the electrodes."""
        return tuple(electrode.name for electrode in self.scene.electrode_list)

    def interpolate(self, points_mm: Array) -> Array:
        """Interpolate the charges at positions of the probe.

        Parameters
        ----------
        points_mm : ndarray, shape (n, 2)
            Positions of the probe in mm.

        Returns
        -------
        ndarray, shape (n, electrodes)
            Total charges in pC.
        """
        values = self.spline(points_mm)
        logarithms = np.where(self.is_logarithmic, values, 0.0)
        powers = np.exp(np.clip(logarithms, -MAX_LOGARITHM, MAX_LOGARITHM))
        return np.where(self.is_logarithmic, powers, values)

    def evaluate(self, touches: Array) -> tuple[Array, Array]:
        """Evaluate the charges of touches, and their derivatives by central differences.

        Parameters
        ----------
        touches : ndarray, shape (n, 4)
            Rows of x and y in mm, rotation and force. Rotation and force are ignored.

        Returns
        -------
        charges : ndarray, shape (n, electrodes)
            Total charges in pC.
        slopes : ndarray, shape (n, electrodes, 4)
            Derivatives with respect to x and y in pC/mm; zeros for rotation and force.
        """
        positions = touches[:, : TouchColumn.ROTATION]
        step = RELATIVE_STEP * self.domain.reach_mm
        steps = step * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        around = (positions[:, None] + steps).reshape(-1, 2)
        charges = self.interpolate(around).reshape(len(positions), 4, -1)
        slopes = (charges[:, ::2] - charges[:, 1::2]).swapaxes(1, 2) / (2.0 * step)
        return self.interpolate(positions), np.pad(slopes, ((0, 0), (0, 0), (0, 2)))


def _fit_spline(points_mm: Array, values: Array) -> RBFInterpolator:
    """Fit a spline through values, shape (n, electrodes), at points in mm, shape (n, 2)."""
    return RBFInterpolator(points_mm, values, kernel="quintic", degree=2)


def _cross_validate_spline(points_mm: Array, values: Array) -> Array:
    """Estimate the errors of the spline by cross-validation with `FOLDS` folds.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 2)
        Points in mm.
    values : ndarray, shape (n, electrodes)
        Values at the points.

    Returns
    -------
    ndarray, shape (n, electrodes)
        Errors at the points of each fold of a spline that is fitted without this fold.
    """
    errors = np.empty_like(values)
    folds = np.arange(len(values)) % FOLDS
    for fold in range(FOLDS):
        is_left_out = folds == fold
        spline = _fit_spline(points_mm[~is_left_out], values[~is_left_out])
        errors[is_left_out] = spline(points_mm[is_left_out]) - values[is_left_out]
    return errors
