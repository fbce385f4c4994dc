"""The other codes that are there, and the jobs they get."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from pvdf_fem.solution.first_sizes import first_sizes
from reports.speed import peer_calculix, peer_ngsolve
from reports.speed.cases import BenchmarkCase
from reports.speed.runs import Job, Outcome


@dataclass(frozen=True)
class CalculixWorkload:
    """How much CalculiX solves.

    Attributes
    ----------
    everywhere, closely : tuple of (str, float)
        Element types and multiples of the thesis's mesh sizes, for every scene and for one more
        closely studied scene in addition.
    limit : float
        Seconds after which a run is ended.
    """

    everywhere: tuple[tuple[str, float], ...]
    closely: tuple[tuple[str, float], ...]
    limit: float


class Peers:
    """NGSolve's process and CalculiX, if they are installed.

    Attributes
    ----------
    versions, absent : dict
        Version of each code that takes part, and why each of the others does not, by name.
    """

    def __init__(self) -> None:
        self.versions: dict[str, str] = {}
        self.absent: dict[str, str] = {}
        self._worker: peer_ngsolve.Worker | None = None
        try:
            self._worker = peer_ngsolve.Worker()
            self.versions[peer_ngsolve.NAME] = self._worker.version
        except RuntimeError as error:
            self.absent[peer_ngsolve.NAME] = str(error)
        try:
            self.versions[peer_calculix.NAME] = peer_calculix.version()
        except RuntimeError as error:
            self.absent[peer_calculix.NAME] = str(error)

    def close(self) -> None:
        """End NGSolve's process."""
        if self._worker is not None:
            self._worker.close()

    def jobs(
        self,
        case: BenchmarkCase,
        orders: dict[int, tuple[float, ...]],
        calculix: CalculixWorkload,
        *,
        close: bool,
    ) -> list[Job]:
        """The jobs of a case: NGSolve by order and size factor, CalculiX by element and factor."""
        jobs = []
        if self._worker is not None:
            for order, factors in orders.items():
                for factor in factors:
                    run = self._ngsolve(case, order, factor)
                    jobs.append(Job(case, peer_ngsolve.NAME, f"order {order}", factor, run))
        if peer_calculix.NAME in self.versions:
            element_factors = calculix.everywhere + (calculix.closely if close else ())
            for element, factor in sorted(
                element_factors, key=lambda element_factor: (element_factor[0], -element_factor[1])
            ):
                run = partial(
                    peer_calculix.solve_calculix, case.scene, element, factor, calculix.limit
                )
                jobs.append(Job(case, peer_calculix.NAME, element, factor, run))
        return jobs

    def _ngsolve(
        self, case: BenchmarkCase, order: int, factor: float, sizes_tolerance: float = 1e-3
    ) -> Callable[[], Outcome]:
        """A run on a mesh with this code's first sizes for `sizes_tolerance`, times `factor`."""
        scene = case.scene.with_(**{"numerics.tolerance": sizes_tolerance})
        sizes = first_sizes(scene, 2).scaled(factor)
        worker = self._worker
        assert worker is not None
        return lambda: Outcome(**worker.solve(case.scene, order, sizes.patches, sizes.film))
