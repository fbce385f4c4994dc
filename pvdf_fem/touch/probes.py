"""Which probe touched, of several whose models are given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pvdf_fem.response.model import QUANTITIES, Model
from pvdf_fem.touch.locate import locate
from pvdf_fem.touch.location import Location
from pvdf_fem.touch.measurement import Deviations


@dataclass(frozen=True, eq=False)
class ProbeMatch:
    """One probe among several that may have given the charges."""

    #: Name of its model.
    name: str
    #: Probability of this probe given the charges, if all probes were equally likely before.
    weight: float
    #: The touches of this probe.
    location: Location


def weigh(
    models: Mapping[str, Model],
    charges_pC: Mapping[str, float],
    sigma: Deviations = 0.01,
    *,
    unknown: Sequence[str] = QUANTITIES,
    **options: Any,
) -> tuple[ProbeMatch, ...]:
    """The probes that may have touched, the most probable first.

    Bayes' rule is applied to the probability density of the charges over all touches of each probe.
    A probe that can give many different charges must explain the measured ones better than a probe
    that can give few. The models are of different probes on the same sensor, by name; the other
    arguments are those of `locate`. Raises `ValueError` without models, and as `locate`.
    """
    if not models:
        raise ValueError("models: none given; give one for each probe in question")
    locations = {
        name: locate(model, charges_pC, sigma, unknown=unknown, **options)
        for name, model in models.items()
    }
    return match(locations)


def match(locations: Mapping[str, Location]) -> tuple[ProbeMatch, ...]:
    """Locations of the same charges with different probes, the most probable first."""
    logs = np.array([location.log_evidence for location in locations.values()])
    weights = np.zeros(len(logs))
    if np.isfinite(logs).any():
        weights = np.exp(logs - np.logaddexp.reduce(logs))
    matches = [
        ProbeMatch(name, weight, location)
        for (name, location), weight in zip(locations.items(), weights.tolist(), strict=True)
    ]
    return tuple(sorted(matches, key=lambda probe: -probe.weight))
