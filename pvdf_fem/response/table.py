"""The table of a response: its grid over place, rotation and force, and the charges in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from pvdf_fem.arrays import Array
from pvdf_fem.progress import Work
from pvdf_fem.response.model import Domain
from pvdf_fem.response.rim_places import ProbeCharges
from pvdf_fem.response.uniform_spline import UniformAxis, UniformSpline
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import Scene

#: Charges are smooth in this power of the force, both where the pretension carries it and where the
#: tension that it makes itself does.
POWER = 1.0 / 6.0
#: Cells by which the table goes beyond the domain, where nobody feels how its splines end.
MARGIN = 6


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
        self, stress: ProbeCharges, scene: Scene, work: Work, dtype: type = np.float32
    ) -> UniformSpline:
        """The spline of a scene's charges in pC, from the stress about its probe."""
        x, y, rotations = (axis.values for axis in self.axes)
        positions = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
        different = rotations if stress.places.probe.period_deg else rotations[:1]
        outlines = [electrode.outline for electrode in scene.electrode_list]
        d_pC_N = scene.film.d31_pC_N, scene.film.d32_pC_N
        tasks = [
            (stress.charges_pC, outlines, positions, float(np.radians(rotation)), d_pC_N)
            for rotation in different
        ]
        # (x y, rotations, forces, electrodes), then polynomials of the force
        by_force = np.stack([*work.run(tasks)], axis=1)
        nodes, _ = scaled_force(self.domain, force_nodes_N(self.domain, self.polynomials))
        inverse = np.linalg.inv(chebyshev.chebvander(nodes, len(nodes) - 1))
        by_order = np.einsum("kf,prfe->prke", inverse, by_force)
        by_order = np.repeat(by_order, len(rotations) // len(different), axis=1)
        shape = (len(x), len(y), len(rotations), -1)
        return UniformSpline.through(self.axes, by_order.reshape(shape), dtype)
