"""Electrode charges as a smooth function of the probe's place.

Charges are solved on rings around the film's centre, and interpolated by a quintic polyharmonic
spline (Duchon 1977) through the logarithms of the charges. The outermost rings are half as far
apart, because the spline must not extrapolate. The rings keep the symmetry of probe and film:
places that are turned or mirrored into each other share one solve. A disc needs one solve for each
ring, a triangle a sixth of the places. The error of the spline is estimated by cross-validation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Self

import numpy as np
from scipy.interpolate import RBFInterpolator

from pvdf_fem.arrays import Array, Mask
from pvdf_fem.report.kind import place_probe
from pvdf_fem.scene.scene import Scene
from pvdf_fem.surrogate.charge_spline import estimate_pressed_outline
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, Domain, TouchColumn

#: Distance of the rings over the root of the areas of probe and smallest electrode. Charges of the
#: thesis's sensor are then within 2e-3.
RELATIVE_PITCH = 0.36
MAX_LOGARITHM = 300.0  #: Largest logarithm of a charge, far outside of the places.
MAX_MISSING_SHARE = 0.1  #: Largest share of the places without charges.
FOLDS = 11  #: Number of parts of the places for cross-validation.
RELATIVE_STEP = 1e-5  #: Step of central differences over the reach.


def choose_pitch_mm(scene: Scene) -> float:
    """Return the distance in mm of neighbouring places that resolves a scene's charges."""
    smallest = min(electrode.outline.area for electrode in scene.electrode_list)
    pressed = 0.0
    if scene.single_probe:
        pressed = estimate_pressed_outline(scene, scene.load.force_N).area
    return 1e3 * RELATIVE_PITCH * math.sqrt(smallest + pressed)


def make_ring_places(reach_mm: float, pitch_mm: float, first_deg: float) -> Array:
    """Return places on rings around the film's centre.

    The number of places on a ring is a multiple of twelve, so that rings are unchanged by turns of
    120 and 90 degrees.

    Parameters
    ----------
    reach_mm : float
        Radius of the outermost ring in mm.
    pitch_mm : float
        Largest distance of neighbouring places in mm.
    first_deg : float
        Direction of the first place on each ring in degrees.

    Returns
    -------
    array (n, 2)
        Places in mm, the centre first.
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
class MapPlaces:
    """The places of the probe for a map of charges.

    Parameters
    ----------
    scene : Scene
        A scene with one probe, whose place does not matter.
    reach_mm : float
        Radius of the map in mm.
    pitch_mm : float, optional
        Distance of neighbouring places in mm, by default `choose_pitch_mm` of the scene.
    """

    scene: Scene
    reach_mm: float
    pitch_mm: float | None = None

    @cached_property
    def places_mm(self) -> Array:
        """Places (n, 2) in mm."""
        pitch = choose_pitch_mm(self.scene) if self.pitch_mm is None else self.pitch_mm
        probe = self.scene.single_probe
        rotation_deg = probe.rotation_deg if probe else 0.0
        return make_ring_places(self.reach_mm, pitch, 90.0 + rotation_deg)

    @cached_property
    def scenes(self) -> list[Scene]:
        """Scenes to solve; `SceneError` without a probe, or where it does not fit."""
        return place_probe(self.scene, self.places_mm)


@dataclass(frozen=True, eq=False)
class ChargeMap:
    """Interpolated charges: a `ChargeFunction` of touches with a fixed force and rotation.

    Parameters
    ----------
    scene : Scene
        The scene, whose probe may be anywhere.
    domain : Domain
        Touches for which the charges are valid.
    spline : RBFInterpolator
        Values (n, electrodes) at places (n, 2) in mm.
    is_logarithmic : bool array (electrodes,)
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
    def fit(cls, places: MapPlaces, charges_pC: Array) -> Self:
        """Interpolate charges at the places of a map.

        Parameters
        ----------
        places : MapPlaces
            Scene and places.
        charges_pC : array (n, electrodes)
            Charges in pC, NaN where a solve gave none. The logarithms of an electrode's charges
            are interpolated where all of them are positive.

        Returns
        -------
        ChargeMap

        Raises
        ------
        ValueError
            Where too many places have no charges.
        """
        is_known = np.isfinite(charges_pC).all(axis=1)
        if is_known.mean() < 1.0 - MAX_MISSING_SHARE:
            raise ValueError(f"{(~is_known).sum()} of the {is_known.size} places have no charges")
        places_mm = places.places_mm[is_known]
        charges = charges_pC[is_known]
        is_logarithmic = np.asarray((charges > 0.0).all(axis=0))
        values = np.where(is_logarithmic, np.log(np.where(is_logarithmic, charges, 1.0)), charges)
        # an error of a logarithm is a relative error already
        scale = np.where(is_logarithmic, 1.0, np.abs(charges).max(axis=0))
        is_inner = np.linalg.norm(places_mm, axis=1) < places.reach_mm - 1e-6
        errors = _cross_validate(places_mm, values)[is_inner] / scale
        force_N = places.scene.load.force_N
        return cls(
            # amplifiers and stage belong to readings; a map has charges on the film
            scene=places.scene.model_copy(update={"readout": None, "stage": None}),
            domain=Domain(places.reach_mm, (force_N, force_N)),
            spline=_fit_spline(places_mm, values),
            is_logarithmic=is_logarithmic,
            error_bound=float(np.sqrt(np.mean(errors**2))),
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the electrodes."""
        return tuple(electrode.name for electrode in self.scene.electrode_list)

    def interpolate(self, places_mm: Array) -> Array:
        """Return the charges (n, electrodes) in pC at places (n, 2) in mm."""
        values = self.spline(places_mm)
        logarithms = np.where(self.is_logarithmic, values, 0.0)
        powers = np.exp(np.clip(logarithms, -MAX_LOGARITHM, MAX_LOGARITHM))
        return np.where(self.is_logarithmic, powers, values)

    def evaluate(self, touches: Array) -> tuple[Array, Array]:
        """Return the charges of touches and their derivatives, by central differences.

        Parameters
        ----------
        touches : array (n, 4)
            Rows of x and y in mm, rotation and force, of which the last two do not matter.

        Returns
        -------
        charges : array (n, electrodes)
            In pC.
        slopes : array (n, electrodes, 4)
            In pC/mm by x and y, zero by rotation and force.
        """
        places = touches[:, : TouchColumn.ROTATION]
        step = RELATIVE_STEP * self.domain.reach_mm
        steps = step * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        around = (places[:, None] + steps).reshape(-1, 2)
        charges = self.interpolate(around).reshape(len(places), 4, -1)
        slopes = (charges[:, ::2] - charges[:, 1::2]).swapaxes(1, 2) / (2.0 * step)
        return self.interpolate(places), np.pad(slopes, ((0, 0), (0, 0), (0, 2)))


def _fit_spline(places_mm: Array, values: Array) -> RBFInterpolator:
    """Return the spline through values (n, electrodes) at places (n, 2)."""
    return RBFInterpolator(places_mm, values, kernel="quintic", degree=2)


def _cross_validate(places_mm: Array, values: Array) -> Array:
    """Return the errors (n, electrodes) at the places of splines that are fitted without them."""
    errors = np.empty_like(values)
    folds = np.arange(len(values)) % FOLDS
    for fold in range(FOLDS):
        is_left_out = folds == fold
        spline = _fit_spline(places_mm[~is_left_out], values[~is_left_out])
        errors[is_left_out] = spline(places_mm[is_left_out]) - values[is_left_out]
    return errors
