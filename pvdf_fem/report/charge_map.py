"""Electrode charges as a smooth function of the probe's place.

Charges are solved on rings around the film's centre, twice as dense at the edge of the disc to
avoid extrapolation. The rings keep the probe's symmetries: on an isotropic round film, places that
are images by a turn or mirror share a solve. A disc needs a solve per ring, a triangle a sixth of
the places. A quintic polyharmonic spline (Duchon 1977) interpolates the charges' logarithms between
places; errors at left-out places give the spline's error.
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

#: Pitch of the rings over the root of the areas of probe and smallest electrode: charges in the
#: thesis's sensor are then within 2e-3.
PITCH = 0.36
MOST_LOG = 300.0  #: Largest logarithm of a charge, far outside of the places.
MOST_MISSING = 0.1  #: Share of the places that may lack a charge.
FOLDS = 11  #: Parts of the places, of which one is left out at a time to see the error.
STEP = 1e-5  #: Of central differences over the reach.


def choose_pitch_mm(scene: Scene) -> float:
    """Distance in mm between neighbouring places that resolves a scene's charges."""
    least = min(electrode.outline.area for electrode in scene.electrode_list)
    pressed = (
        estimate_pressed_outline(scene, scene.load.force_N).area if scene.single_probe else 0.0
    )
    return 1e3 * PITCH * math.sqrt(least + pressed)


def make_ring_places(reach_mm: float, pitch_mm: float, first_deg: float) -> Array:
    """Places (n, 2) in mm on rings up to the reach, starting from an angle.

    Rings have a multiple of twelve places: turns by thirds and quarters keep them.
    """
    count = max(1, math.ceil(reach_mm / pitch_mm - 1e-9))
    radii = [*np.arange(1, count) * (reach_mm / count), reach_mm * (1.0 - 0.5 / count), reach_mm]
    places = [np.zeros((1, 2))]
    for radius in radii:
        around = 12 * max(1, math.ceil(2.0 * math.pi * radius / (12.0 * pitch_mm)))
        angles = math.radians(first_deg) + 2.0 * math.pi * np.arange(around) / around
        places.append(radius * np.column_stack([np.cos(angles), np.sin(angles)]))
    return np.concatenate(places).round(9)


@dataclass(frozen=True)
class MapPlaces:
    """A scene, and its probe's places for a map of charges."""

    scene: Scene
    reach_mm: float
    pitch_mm: float | None = None  #: `choose_pitch_mm` the scene where it is None.

    @cached_property
    def places_mm(self) -> Array:
        """(n, 2)."""
        probe = self.scene.single_probe
        first = 90.0 + (probe.rotation_deg if probe else 0.0)
        return make_ring_places(self.reach_mm, self.pitch_mm or choose_pitch_mm(self.scene), first)

    @cached_property
    def scenes(self) -> list[Scene]:
        """The scenes to solve; SceneError without a probe, or where it does not fit."""
        return place_probe(self.scene, self.places_mm)


@dataclass(frozen=True, eq=False)
class ChargeMap:
    """Interpolated charges: a `Model` of touches with a fixed force and rotation."""

    quantities: ClassVar[tuple[str, ...]] = TOUCH_QUANTITIES
    is_fast: ClassVar[bool] = True
    unloaded_charges_pC: ClassVar[None] = None
    scene: Scene  #: The probe's place does not matter.
    domain: Domain
    spline: RBFInterpolator
    logarithmic: Mask  #: Whether the logarithm of a charge is interpolated, (electrodes,).
    error_bound: float  #: Root mean square of the relative errors at places left out.

    @classmethod
    def of(cls, asked: MapPlaces, charges_pC: Array) -> Self:
        """The map of charges (n, electrodes) at its places; charges of both signs are interpolated
        themselves. Rows of NaN are left out. Raises ValueError where too many are missing."""
        known = np.isfinite(charges_pC).all(axis=1)
        if known.mean() < 1.0 - MOST_MISSING:
            raise ValueError(f"{(~known).sum()} of the {known.size} places have no charges")
        places_mm, charges_pC = asked.places_mm[known], charges_pC[known]
        logarithmic = np.asarray((charges_pC > 0.0).all(axis=0))
        values = np.where(logarithmic, np.log(np.where(logarithmic, charges_pC, 1.0)), charges_pC)
        size = np.where(logarithmic, 1.0, np.abs(charges_pC).max(axis=0))
        inner = np.linalg.norm(places_mm, axis=1) < asked.reach_mm - 1e-6
        errors = _left_out(places_mm, values)[inner] / size
        force = asked.scene.load.force_N
        # channels and stage belong to readings, and a map has charges
        scene = asked.scene.model_copy(update={"readout": None, "stage": None})
        spline, domain = _spline(places_mm, values), Domain(asked.reach_mm, (force, force))
        return cls(scene, domain, spline, logarithmic, float(np.sqrt(np.mean(errors**2))))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the electrodes."""
        return tuple(electrode.name for electrode in self.scene.electrode_list)

    def charges(self, places_mm: Array) -> Array:
        """Charges (n, electrodes) in pC at places (n, 2)."""
        values = self.spline(places_mm)
        powers = np.exp(np.clip(np.where(self.logarithmic, values, 0.0), -MOST_LOG, MOST_LOG))
        return np.where(self.logarithmic, powers, values)

    def evaluate(self, touches: Array) -> tuple[Array, Array]:
        """Charges (n, electrodes) in pC of touches (n, 4), and slopes (n, electrodes, 4)."""
        places, step = touches[:, : TouchColumn.ROTATION], STEP * self.domain.reach_mm
        steps = step * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        near = self.charges((places[:, None] + steps).reshape(-1, 2)).reshape(len(places), 4, -1)
        slopes = (near[:, ::2] - near[:, 1::2]).swapaxes(1, 2) / (2.0 * step)
        return self.charges(places), np.pad(slopes, ((0, 0), (0, 0), (0, 2)))


def _spline(places_mm: Array, values: Array) -> RBFInterpolator:
    return RBFInterpolator(places_mm, values, kernel="quintic", degree=2)


def _left_out(places_mm: Array, values: Array) -> Array:
    """Errors (n, electrodes) at the places, by a spline without the place and further distant
    places."""
    errors = np.empty_like(values)
    for fold in range(FOLDS):
        left_out = np.arange(len(values)) % FOLDS == fold
        kept = _spline(places_mm[~left_out], values[~left_out])
        errors[left_out] = kept(places_mm[left_out]) - values[left_out]
    return errors
