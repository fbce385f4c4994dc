"""Records of solved scenes in an SQLite file that survives a killed process.

Each scene has a row. The row's key is a hash over the solved part of the scene, its numerics and
file contents, and the source of every module with influence on numbers: results from older code are
never taken for new results. The rows of a solve are committed together, right after the solve.
Several programs may use one file: each looks into the file right before a solve.
"""

from __future__ import annotations

import hashlib
import json
import os
import sqlite3
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any, Self

import numpy as np

from pvdf_fem.electrodes.stress_integrals import StressIntegrals
from pvdf_fem.files import FileError
from pvdf_fem.film.loads.profiles import pin_profile_files
from pvdf_fem.scene.keys import Affects, select_by_effect
from pvdf_fem.scene.scene import Scene

# SQLite's application id of our files: "pvd" in ASCII, and the version of their table.
APPLICATION_ID = 0x70766403
# Longest wait in s for further programs that write to the file.
LONGEST_WAIT = 60.0
# Folders and packages with influence on a record's numbers.
NUMERICAL_FOLDERS = ("scene", "mesh", "film", "problem", "electrodes", "solver", "batch")
NUMERICAL_PACKAGES = ("gmsh", "numpy", "scikit-fem", "scipy")

_SIGN = f"PRAGMA application_id = {APPLICATION_ID}"
_REMOVE = "name another file or remove this one"
_UNLOCK = "make it and its folder writable, or name another file"
_ADVICE = {
    sqlite3.SQLITE_CORRUPT: _REMOVE,
    sqlite3.SQLITE_NOTADB: _REMOVE,
    sqlite3.SQLITE_BUSY: "wait until no other program writes to it",
    sqlite3.SQLITE_READONLY: _UNLOCK,
    sqlite3.SQLITE_CANTOPEN: _UNLOCK,
    sqlite3.SQLITE_MISUSE: "open a Store in each thread, and use none that is closed",
}


class StoreError(FileError):
    """A file cannot serve as a store; the text names the file and says what to do."""


@dataclass(frozen=True)
class Record:
    """A solution without its fields."""

    status: str
    reason: str
    electrodes: tuple[str, ...]  #: Names of the electrodes.
    #: By observable the electrodes' forces X, Y in N; d31 X + d32 Y is its charge.
    #: Empty for a scene that has not converged.
    integrals: dict[str, list[list[float]]] = field(default_factory=dict)
    #: Estimated errors of forces by the scene's observable.
    integral_errors: dict[str, list[list[float]]] = field(default_factory=dict)
    deflection_max_mm: float = 0.0
    warnings: tuple[str, ...] = ()
    seconds: float = 0.0
    #: Forces by the scene's observable on the untouched film, and their errors; empty if not known.
    unloaded_integrals: list[list[float]] = field(default_factory=list)
    unloaded_integral_errors: list[list[float]] = field(default_factory=list)

    @property
    def unloaded(self) -> StressIntegrals:
        """`unloaded_integrals` with their errors; NaN if not known."""
        return self._make_integrals(self.unloaded_integrals, self.unloaded_integral_errors)

    @property
    def converged(self) -> bool:
        """Whether there are charges."""
        return self.status == "converged"

    def integrals_by(self, observable: str) -> StressIntegrals:
        """The electrodes' forces; NaN for a record without charges. Their errors are NaN for an
        observable different from the scene's, too."""
        return self._make_integrals(
            self.integrals.get(observable), self.integral_errors.get(observable)
        )

    def charges_pC(
        self, d31_pC_N: float, d32_pC_N: float, observable: str = "material"
    ) -> dict[str, float]:
        """Charges in pC by electrode; NaN for a record without charges."""
        charges = self.integrals_by(observable).charges((d31_pC_N, d32_pC_N))
        return dict(zip(self.electrodes, charges.tolist(), strict=True))

    def charge_errors_pC(
        self, d31_pC_N: float, d32_pC_N: float, observable: str = "material"
    ) -> dict[str, float]:
        """Estimated errors of `charges_pC`; NaN for an observable different from the scene's,
        too."""
        errors = self.integrals_by(observable).charge_errors((d31_pC_N, d32_pC_N))
        return dict(zip(self.electrodes, errors.tolist(), strict=True))

    def _make_integrals(self, values: Any, errors: Any) -> StressIntegrals:
        unknown = np.full((len(self.electrodes), 2), np.nan)
        return StressIntegrals(
            *(np.array(given) if given else unknown for given in (values, errors))
        )


class Store:
    """Records by scene, in a file made on demand. Several processes may use one
    file. A file that cannot be written is read. Raises `StoreError` if the file is damaged, or is
    no store of this version."""

    def __init__(self, path: Path) -> None:
        self._path = path
        with self._told():
            name = os.path.abspath(path)
            self._rows = sqlite3.connect(name, timeout=LONGEST_WAIT, isolation_level=None)
        try:
            self._open()
        except BaseException:
            self._rows.close()
            raise

    def _open(self) -> None:
        if self._is_empty():
            with self._writing():
                if self._is_empty():  # and no other process has made the store meanwhile
                    self._execute("CREATE TABLE records (key PRIMARY KEY, record) WITHOUT ROWID")
                    self._execute(_SIGN)
        state = self._execute("PRAGMA integrity_check(1)")
        if state != ("ok",):
            raise StoreError(f"{self._path}: damaged: {state[0]}; {_REMOVE}")

    def _is_empty(self) -> bool:
        """Whether the file has no tables; raises `StoreError` for tables of another kind."""
        # in this order, because another process may make the store between the two
        (tables,) = self._execute("SELECT count(*) FROM sqlite_master")
        (kind,) = self._execute("PRAGMA application_id")
        if kind != APPLICATION_ID and (kind or tables):
            raise StoreError(f"{self._path}: not a store of this version of pvdf_fem; {_REMOVE}")
        return not kind

    def get(self, scene: Scene) -> Record | None:
        """The record of a scene; None if missing, or if its row is damaged."""
        fields = self.kept(make_record_key(scene))
        if fields is None:
            return None
        return Record(**fields | {name: tuple(fields[name]) for name in ("electrodes", "warnings")})

    def kept(self, name: str) -> Any:
        """What `keep` has put under a key; None if there is nothing, or its row is damaged."""
        row = self._execute("SELECT record FROM records WHERE key = ?", name)
        try:
            whose, values = json.loads(zlib.decompress(row[0])) if row else (None, None)
        except (zlib.error, TypeError):  # the checksum of zlib, or a number in place of bytes
            return None
        return values if whose == name else None

    def __contains__(self, scene: Scene) -> bool:
        return self.get(scene) is not None

    def put(self, records: Iterable[tuple[Scene, Record]]) -> None:
        """Add the records of scenes in a single transaction."""
        self.keep({make_record_key(scene): vars(record) for scene, record in records})

    def keep(self, values: Mapping[str, Any]) -> None:
        """Add values for JSON, by key, in a single transaction."""
        with self._writing():
            for name, value in values.items():
                text = zlib.compress(json.dumps([name, value]).encode())
                self._execute("INSERT OR REPLACE INTO records VALUES (?, ?)", name, text)

    def require_writable(self) -> None:
        """Raise `StoreError` when the file cannot be written: records would be lost."""
        self._execute(_SIGN)

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """A transaction, rolled back on an error."""
        with self._told(), self._rows:
            self._execute("BEGIN IMMEDIATE")
            yield

    def _execute(self, query: str, *values: str | bytes) -> Any:
        """The first row of a query's result."""
        with self._told():
            return self._rows.execute(query, values).fetchone()

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Errors of the file as `StoreError`."""
        try:
            yield
        except (sqlite3.Error, OSError, UnicodeDecodeError) as error:
            code = getattr(error, "sqlite_errorcode", 0)
            if isinstance(error, UnicodeDecodeError):  # SQLite's texts may be damaged, too
                code = sqlite3.SQLITE_CORRUPT
            elif isinstance(error, sqlite3.ProgrammingError):
                code = sqlite3.SQLITE_MISUSE
            advice = _ADVICE.get(code & 0xFF, "name another file or see to its disk")
            raise StoreError(f"{self._path}: {error}; {advice}") from error

    def close(self) -> None:
        """Close the file."""
        with self._told():
            self._rows.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def make_record_key(scene: Scene, folders: tuple[str, ...] = NUMERICAL_FOLDERS) -> str:
    """Hash over the scene's fields that affect a record and over the code in `folders`."""
    (scene,) = pin_profile_files([scene])
    # with coupling, amplifiers and the permittivity act on the film
    effects = [*Affects] if scene.film.coupling else set(Affects) - {Affects.INSTRUMENT}
    solved = repr(select_by_effect(scene, *effects))
    return hashlib.sha256((hash_code(folders) + solved).encode()).hexdigest()


@cache
def hash_code(folders: tuple[str, ...] = NUMERICAL_FOLDERS) -> str:
    """Hash over modules in folders of the package and the libraries' versions."""
    digest = hashlib.sha256()
    for name in NUMERICAL_PACKAGES:
        digest.update(f"{name} {metadata.version(name)}\n".encode())
    for module in list_modules(folders):
        digest.update(module.read_bytes())
    return digest.hexdigest()


def list_modules(folders: tuple[str, ...] = NUMERICAL_FOLDERS) -> list[Path]:
    """Modules in folders of the package, and shared modules."""
    package = Path(__file__).parents[1]
    modules = (module for folder in folders for module in package.joinpath(folder).rglob("*.py"))
    return [package / "arrays.py", *sorted(modules)]
