"""Results that survive: each finished scene is a row of an SQLite file.

A row's key is a hash of the scene, numerics included, and of the source of every module that
numbers depend on, so that results of older code are never taken for new ones. A row is committed
as soon as its scene is solved.
"""

from __future__ import annotations

import hashlib
import json
import sqlite3
from dataclasses import asdict, dataclass
from functools import cache
from importlib import metadata, resources
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from pvdf_fem.scene import Scene

# "pvdf" in ASCII; tells our files from other SQLite files.
APPLICATION_ID = 0x70766466
SCHEMA = 1
# What the numbers of a record depend on.
NUMERICAL_MODULES = (
    *("film", "shapes", "outline", "mesh", "membrane", "load", "equilibrium"),
    *("newton", "tension_field", "interior_point", "tension_newton", "admissible"),
    *("charge", "estimate", "refine", "solution", "sweep"),
)
NUMERICAL_PACKAGES = ("gmsh", "numpy", "scikit-fem", "scipy")


class StoreError(RuntimeError):
    """A file cannot serve as a store; the text names it and what to do."""


@dataclass(frozen=True)
class Record:
    """What is kept of a solution: all but its fields.

    Attributes
    ----------
    status, reason : str
    electrodes : tuple of str
        Names.
    forces, force_errors : dict
        For each observable the forces X, Y in N of each electrode with d31 X + d32 Y the charge,
        and the estimated errors of those of the scene's own observable.
    deflection_max_mm, seconds : float
    unknowns, newton_iterations : int
    warnings : tuple of str
    """

    status: str
    reason: str
    electrodes: tuple[str, ...]
    forces: dict[str, list[list[float]]]
    force_errors: dict[str, list[list[float]]]
    deflection_max_mm: float
    unknowns: int
    newton_iterations: int
    warnings: tuple[str, ...]
    seconds: float

    @property
    def converged(self) -> bool:
        """Whether there are charges."""
        return self.status == "converged"

    def charges_pC(
        self, d31_pC_N: float, d32_pC_N: float, observable: str = "material"
    ) -> dict[str, float]:
        """Charges in pC by electrode; raises `KeyError` for a record without."""
        values = np.reshape(self.forces[observable], (-1, 2)) @ [d31_pC_N, d32_pC_N]
        return dict(zip(self.electrodes, values.tolist(), strict=True))

    def charge_pC(
        self,
        electrode: str,
        observable: str = "material",
        d31_pC_N: float = 8.0,
        d32_pC_N: float = 8.0,
    ) -> float:
        """Charge in pC of one electrode; NaN for a record without charges."""
        return self._charge(self.forces, electrode, observable, d31_pC_N, d32_pC_N)

    def charge_error_pC(
        self,
        electrode: str,
        observable: str = "material",
        d31_pC_N: float = 8.0,
        d32_pC_N: float = 8.0,
    ) -> float:
        """Estimated error of `charge_pC`; NaN for another observable than the scene's own."""
        return abs(self._charge(self.force_errors, electrode, observable, d31_pC_N, d32_pC_N))

    def _charge(
        self, forces: dict[str, list[list[float]]], electrode: str, observable: str, *d: float
    ) -> float:
        if observable not in forces:
            return np.nan
        return float(np.dot(forces[observable][self.electrodes.index(electrode)], d))


class Store:
    """Records by scene, in a file.

    Parameters
    ----------
    path : Path
        Made if it does not exist; several processes may use one file.
    code : str
        Hash of whatever else than this package makes the records.

    Raises
    ------
    StoreError
        When the file is damaged, or is not a store of this version.
    """

    def __init__(self, path: Path, code: str = "") -> None:
        self._path, self._code = path, code
        try:
            self._rows = sqlite3.connect(path, timeout=60.0, isolation_level=None)
            self._open()
        except sqlite3.Error as error:
            raise StoreError(f"{path}: {error}; name another file or remove this one") from error

    def _open(self) -> None:
        (kind,) = self._rows.execute("PRAGMA application_id").fetchone()
        (schema,) = self._rows.execute("PRAGMA user_version").fetchone()
        (tables,) = self._rows.execute("SELECT count(*) FROM sqlite_master").fetchone()
        if (tables or kind or schema) and (kind, schema) != (APPLICATION_ID, SCHEMA):
            raise StoreError(
                f"{self._path}: not a store of pvdf_fem, version {SCHEMA}; name another file"
            )
        self._rows.execute("PRAGMA journal_mode = WAL")
        self._rows.execute("BEGIN IMMEDIATE")
        self._rows.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        self._rows.execute(f"PRAGMA user_version = {SCHEMA}")
        self._rows.execute("CREATE TABLE IF NOT EXISTS records (key TEXT PRIMARY KEY, record TEXT)")
        self._rows.execute("COMMIT")

    def get(self, scene: Scene) -> Record | None:
        """The record of a scene, if there is one."""
        query = "SELECT record FROM records WHERE key = ?"
        row = self._rows.execute(query, (self._code + key(scene),)).fetchone()
        if row is None:
            return None
        fields = json.loads(row[0])
        fields["electrodes"], fields["warnings"] = (
            tuple(fields[name]) for name in ("electrodes", "warnings")
        )
        return Record(**fields)

    def put(self, scene: Scene, record: Record) -> None:
        """Keep the record of a scene."""
        text = json.dumps(asdict(record))
        self._rows.execute(
            "INSERT OR REPLACE INTO records VALUES (?, ?)", (self._code + key(scene), text)
        )

    def close(self) -> None:
        """Close the file."""
        self._rows.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def key(scene: Scene) -> str:
    """Hash of a scene and of the code that solves it."""
    return hashlib.sha256((code_version() + scene.model_dump_json()).encode()).hexdigest()


@cache
def code_version() -> str:
    """Hash of the modules that numbers depend on and of the libraries' versions."""
    digest = hashlib.sha256()
    for name in NUMERICAL_PACKAGES:
        digest.update(f"{name} {metadata.version(name)}\n".encode())
    for module in NUMERICAL_MODULES:
        digest.update(resources.files("pvdf_fem").joinpath(f"{module}.py").read_bytes())
    return digest.hexdigest()
