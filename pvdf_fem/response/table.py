"""The table of a response: its grid over place, rotation and force, and the charges in it."""

from __future__ import annotations

from dataclasses import dataclass

import joblib
import numpy as np
from numpy.polynomial import chebyshev

from pvdf_fem.arrays import Array
from pvdf_fem.response.model import Domain
from pvdf_fem.response.rim_places import ProbeCharges
from pvdf_fem.response.uniform_spline import UniformAxis, UniformSpline
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import Scene

#: Charges are smooth in this power of the force, both where the pretension carries it and where the
#: tension that it makes itself does.
POWER = 1.0 / 6.0
MARGIN = 3  #: Cells by which the table goes beyond the domain.
#: Cells from one to the next of the three places of a parabola that continues charges outwards.
APART = 2.0
#: Cells beyond which it is continued by a constant, as nothing there counts within the domain.
CONTINUED = 6.0


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


def pressed_outline(scene: Scene, force_N: float) -> Outline:
    """Outline of a scene's probe at the film's centre, or of the contact that a force makes."""
    from pvdf_fem.film.loads.contact_guess import first_contacts  # with scikit-fem

    centred = scene.with_(**{"probe.x_mm": 0.0, "probe.y_mm": 0.0, "load.force_N": force_N})
    (touch,) = centred.loaded_probes
    return first_contacts(centred).get(touch.patch, touch.outline)


@dataclass(frozen=True)
class Grid:
    """Touches at which charges are tabulated."""

    domain: Domain
    #: x and y in mm, rotation in degrees.
    axes: tuple[UniformAxis, ...]
    #: Number of Chebyshev polynomials of the force.
    polynomials: int

    @classmethod
    def of(
        cls, scene: Scene, domain: Domain, cell_mm: float, rotation_step: float, polynomials: int
    ) -> Grid:
        """A grid with cells of a size; see `ResponseOptions`."""
        half = int(np.ceil(domain.reach_mm / cell_mm)) + MARGIN
        across = UniformAxis(-half * cell_mm, cell_mm, 2 * half + 1)
        assert scene.single_probe is not None
        period, rotations = scene.single_probe.period_deg or 360.0, 4
        if scene.single_probe.period_deg:
            way = np.radians(period) * 1e3 * pressed_outline(scene, domain.force_N[1]).reach
            rotations = max(4, int(np.ceil(way / (rotation_step * cell_mm))))
        axis = UniformAxis(0.0, period / rotations, rotations, periodic=True)
        return cls(domain, (across, across, axis), polynomials)

    def charges(
        self, stress: ProbeCharges, scene: Scene, processes: int, dtype: type = np.float32
    ) -> UniformSpline:
        """The spline of a scene's charges in pC, from the stress about its probe."""
        x, y, rotations = (axis.values for axis in self.axes)
        positions = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
        different = rotations if stress.places.probe.period_deg else rotations[:1]
        with joblib.parallel_config("loky", inner_max_num_threads=1):
            by_rotation = joblib.Parallel(processes)(
                joblib.delayed(self._charges)(stress, scene, positions, np.radians(rotation))
                for rotation in different
            )
        # (x y, rotations, forces, electrodes), then polynomials of the force
        by_force = np.stack(by_rotation, axis=1)
        nodes, _ = scaled_force(self.domain, force_nodes_N(self.domain, self.polynomials))
        inverse = np.linalg.inv(chebyshev.chebvander(nodes, len(nodes) - 1))
        by_order = np.einsum("kf,prfe->prke", inverse, by_force)
        by_order = np.repeat(by_order, len(rotations) // len(different), axis=1)
        shape = (len(x), len(y), len(rotations), -1)
        return UniformSpline.through(self.axes, by_order.reshape(shape), dtype)

    def _charges(
        self, stress: ProbeCharges, scene: Scene, positions_mm: Array, rotation: float
    ) -> Array:
        """Charges (n, forces, electrodes), continued by parabolas along the radius outside."""
        cell = self.axes[0].step
        limit = self.domain.reach_mm + MARGIN * cell
        distance = np.linalg.norm(positions_mm, axis=-1)
        inside, far = np.flatnonzero(distance <= limit), np.flatnonzero(distance > limit)
        count = int(np.ceil(2.0 * np.pi * limit / cell))
        around = UniformAxis(0.0, 2.0 * np.pi / count, count, periodic=True)
        unit = np.stack([np.cos(around.values), np.sin(around.values)], axis=-1)
        rings = [(limit - k * APART * cell) * unit for k in range(3)]
        outlines = [electrode.outline for electrode in scene.electrode_list]
        d_pC_N = scene.film.d31_pC_N, scene.film.d32_pC_N
        places = np.concatenate([positions_mm[inside], *rings])
        values = stress.charges_pC(outlines, places, rotation, d_pC_N)
        charges = np.empty((len(positions_mm), *values.shape[1:]))
        charges[inside], on_rings = values[: len(inside)], values[len(inside) :]
        on_rings = on_rings.reshape(3, count, -1).swapaxes(0, 1).reshape(count, -1)
        angle = np.arctan2(positions_mm[far, 1], positions_mm[far, 0])
        rings_at = UniformSpline.through([around], on_rings).with_gradient(angle[:, None])[:, 0]
        t = np.minimum((distance[far] - limit) / cell, CONTINUED) / APART
        parabola = np.stack([(t + 1) * (t + 2) / 2, -t * (t + 2), t * (t + 1) / 2], axis=-1)
        outside = np.einsum("nk,nkm->nm", parabola, rings_at.reshape(len(far), 3, -1))
        charges[far] = outside.reshape(len(far), *charges.shape[1:])
        return charges
