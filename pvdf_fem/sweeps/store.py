"""Results that survive: each finished scene is a row of an SQLite file.

A row's key is a hash of the scene, numerics included, and of the source of every module that
numbers depend on, so that results of older code are never taken for new ones. Rows are committed
as soon as their scenes are solved, those of one solve together.
"""

from __future__ import annotations

import hashlib
import json
import sqlite3
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from pvdf_fem.charges.errors import charge_errors
from pvdf_fem.files import FileError
from pvdf_fem.scene.scene import Scene

# "pvdf" in ASCII; tells our files from other SQLite files.
APPLICATION_ID = 0x70766466
SCHEMA = 2
# What the numbers of a record depend on.
NUMERICAL_FOLDERS = ("scene", "mesh", "film", "charges", "solvers", "solution", "sweeps")
NUMERICAL_PACKAGES = ("gmsh", "numpy", "scikit-fem", "scipy")


class StoreError(FileError):
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

    def charge_errors_pC(
        self, d31_pC_N: float, d32_pC_N: float, observable: str = "material"
    ) -> dict[str, float]:
        """Estimated errors of `charges_pC`; `KeyError` for another than the scene's observable."""
        forces, errors = (of[observable] for of in (self.forces, self.force_errors))
        of_all = np.reshape(forces, (-1, 2)), np.reshape(errors, (-1, 2))
        values = charge_errors(*of_all, (d31_pC_N, d32_pC_N))
        return dict(zip(self.electrodes, values.tolist(), strict=True))

    def charge_pC(
        self,
        electrode: str,
        observable: str = "material",
        d31_pC_N: float = 8.0,
        d32_pC_N: float = 8.0,
    ) -> float:
        """Charge in pC of one electrode; NaN for a record without charges."""
        if observable not in self.forces:
            return np.nan
        return self.charges_pC(d31_pC_N, d32_pC_N, observable)[electrode]

    def charge_error_pC(
        self,
        electrode: str,
        observable: str = "material",
        d31_pC_N: float = 8.0,
        d32_pC_N: float = 8.0,
    ) -> float:
        """Estimated error of `charge_pC`; NaN for another observable than the scene's own."""
        if observable not in self.force_errors:
            return np.nan
        return self.charge_errors_pC(d31_pC_N, d32_pC_N, observable)[electrode]


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
        except sqlite3.Error as error:
            raise self._error(error) from error
        try:
            self._open()
        except BaseException:
            self._rows.close()
            raise

    def _open(self) -> None:
        (kind,) = self._execute("PRAGMA application_id")
        (schema,) = self._execute("PRAGMA user_version")
        (tables,) = self._execute("SELECT count(*) FROM sqlite_master")
        if (tables or kind or schema) and (kind, schema) != (APPLICATION_ID, SCHEMA):
            raise StoreError(
                f"{self._path}: not a store of pvdf_fem, version {SCHEMA}; name another file "
                "or remove this one"
            )
        state = self._execute("PRAGMA quick_check(1)")
        if state != ("ok",):
            raise self._error(sqlite3.DatabaseError(f"damaged: {state[0]}"))
        self._execute("PRAGMA journal_mode = WAL")
        self._execute("BEGIN IMMEDIATE")
        self._execute(f"PRAGMA application_id = {APPLICATION_ID}")
        self._execute(f"PRAGMA user_version = {SCHEMA}")
        self._execute("CREATE TABLE IF NOT EXISTS records (key TEXT PRIMARY KEY, record TEXT)")
        self._execute("COMMIT")

    def get(self, scene: Scene) -> Record | None:
        """The record of a scene, if there is one whose text is still what was kept."""
        text = self._text(scene)
        if text is None:
            return None
        fields = json.loads(text)
        fields["electrodes"], fields["warnings"] = (
            tuple(fields[name]) for name in ("electrodes", "warnings")
        )
        return Record(**fields)

    def __contains__(self, scene: Scene) -> bool:
        return self._text(scene) is not None

    def _text(self, scene: Scene) -> str | None:
        name = self._code + key(scene)
        row = self._execute("SELECT record FROM records WHERE key = ?", name)
        text = row[0][8:] if row and isinstance(row[0], str) else ""
        return text if text and row[0] == _sum(name, text) + text else None

    def put(self, records: Iterable[tuple[Scene, Record]]) -> None:
        """Keep the records of scenes, all or none."""
        rows = []
        for scene, record in records:
            name, text = self._code + key(scene), json.dumps(vars(record))
            rows.append((name, _sum(name, text) + text))
        try:
            with self._rows:
                self._rows.execute("BEGIN IMMEDIATE")
                self._rows.executemany("INSERT OR REPLACE INTO records VALUES (?, ?)", rows)
        except sqlite3.Error as error:
            raise self._error(error) from error

    def _execute(self, query: str, *values: str) -> Any:
        """The first row that a query gives."""
        try:
            return self._rows.execute(query, values).fetchone()
        except (sqlite3.Error, UnicodeDecodeError) as error:  # the latter in a damaged complaint
            raise self._error(error) from error

    def _error(self, error: Exception) -> StoreError:
        damaged = not isinstance(error, sqlite3.OperationalError)
        advice = "remove this one" if damaged else "see to its disk"
        return StoreError(f"{self._path}: {error}; name another file or {advice}")

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


def _sum(name: str, text: str) -> str:
    """Eight characters that tell a damaged row, which SQLite would not notice."""
    return f"{zlib.crc32((name + text).encode()):08x}"


def key(scene: Scene) -> str:
    """Hash of a scene and of the code that solves it."""
    return hashlib.sha256((code_version() + scene.model_dump_json()).encode()).hexdigest()


@cache
def code_version() -> str:
    """Hash of the modules that numbers depend on and of the libraries' versions."""
    digest = hashlib.sha256()
    for name in NUMERICAL_PACKAGES:
        digest.update(f"{name} {metadata.version(name)}\n".encode())
    package = Path(__file__).parents[1]
    for folder in NUMERICAL_FOLDERS:
        for module in sorted(package.joinpath(folder).glob("*.py")):
            digest.update(module.read_bytes())
    return digest.hexdigest()
