"""The other codes that are there, and the jobs they get."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from types import TracebackType
from typing import Self

from pvdf_fem.solution.first_sizes import first_sizes
from reports.speed import peer_calculix, peer_ngsolve
from reports.speed.cases import Case
from reports.speed.runs import Job, Outcome

# The scale of the element sizes that NGSolve's meshes share with ours.
SIZES_AT = 1e-3


@dataclass(frozen=True)
class CalculixPlan:
    """Element types and multiples of the thesis's mesh sizes, for every scene and for one."""

    everywhere: tuple[tuple[str, float], ...]
    closely: tuple[tuple[str, float], ...]
    limit: float


class Peers:
    """NGSolve's process and CalculiX, as far as they are there.

    Attributes
    ----------
    versions, absent : dict
        By name of the code: its version, or why it takes no part.
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

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._worker is not None:
            self._worker.close()

    def jobs(
        self,
        case: Case,
        orders: dict[int, tuple[float, ...]],
        calculix: CalculixPlan,
        *,
        close: bool,
    ) -> list[Job]:
        """The jobs of a case: NGSolve by order and size factor, CalculiX by element and factor."""
        found = []
        if self._worker is not None:
            for order, factors in orders.items():
                for factor in factors:
                    run = self._ngsolve(case, order, factor)
                    found.append(Job(case, peer_ngsolve.NAME, f"order {order}", factor, run))
        if peer_calculix.NAME in self.versions:
            plan = calculix.everywhere + (calculix.closely if close else ())
            for element, factor in sorted(plan, key=lambda one: (one[0], -one[1])):
                run = partial(
                    peer_calculix.solve_calculix, case.scene, element, factor, calculix.limit
                )
                found.append(Job(case, peer_calculix.NAME, element, factor, run))
        return found

    def _ngsolve(self, case: Case, order: int, factor: float) -> Callable[[], Outcome]:
        scene = case.scene.with_(**{"numerics.tolerance": SIZES_AT})
        sizes = first_sizes(scene, 2).scaled(factor)
        worker = self._worker
        assert worker is not None
        return lambda: Outcome(**worker.solve(case.scene, order, sizes.patches, sizes.film))
