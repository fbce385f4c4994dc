"""Records of solved scenes in an SQLite file that survives a killed process.

Each scene has a row. The row's key is a hash over the solved part of the scene, its numerics and
file contents, and the source of every module with influence on numbers: results from older code are
never taken for new results. The rows of a solve are committed together, right after the solve.
Several programs may use one file: each looks into the file right before a solve.
"""

from __future__ import annotations

import json
import os
import sqlite3
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np

from pvdf_fem.batch.keys import make_record_key
from pvdf_fem.electrodes.stress_integrals import StressIntegrals
from pvdf_fem.files import FileError
from pvdf_fem.scene.scene import Scene

#: SQLite's application id of our files: "pvd" in ASCII, and the version of their table.
APPLICATION_ID = 0x70766403
#: Longest wait in s for other programs that write to the file.
LONGEST_WAIT = 60.0

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
    """The charges, errors and warnings of a scene's solution, without displacement and stress."""

    status: str
    reason: str
    electrodes: tuple[str, ...]  #: Names of the electrodes.
    #: For each observable the stress integrals X, Y of the electrodes in N, (electrodes, 2): the
    #: charge is d31 X + d32 Y. Empty for a scene that has not converged.
    integrals: dict[str, list[list[float]]] = field(default_factory=dict)
    #: Estimated errors of the integrals, for the scene's observable only.
    integral_errors: dict[str, list[list[float]]] = field(default_factory=dict)
    deflection_max_mm: float = 0.0
    warnings: tuple[str, ...] = ()
    seconds: float = 0.0
    #: Stress integrals of the unloaded film by the scene's observable, and their errors; empty if
    #: they are not known.
    unloaded_integrals: list[list[float]] = field(default_factory=list)
    unloaded_integral_errors: list[list[float]] = field(default_factory=list)

    @property
    def unloaded(self) -> StressIntegrals:
        """Stress integrals of the unloaded film; NaN if they are not known."""
        return self._make_integrals(self.unloaded_integrals, self.unloaded_integral_errors)

    @property
    def converged(self) -> bool:
        """Whether the solve has converged, so that the record has charges."""
        return self.status == "converged"

    def integrals_by(self, observable: str) -> StressIntegrals:
        """Return the electrodes' stress integrals for an observable; NaN if there are none.

        The errors are NaN for an observable that is not the scene's.
        """
        values = self.integrals.get(observable)
        errors = self.integral_errors.get(observable)
        return self._make_integrals(values, errors)

    def charges_pC(
        self, d31_pC_N: float, d32_pC_N: float, observable: str = "material"
    ) -> dict[str, float]:
        """Return the charges in pC by electrode; NaN for a record without charges.

        Parameters
        ----------
        d31_pC_N, d32_pC_N : float
            Piezoelectric coefficients.
        observable : str, optional
            Name of the observable.
        """
        charges = self.integrals_by(observable).charges((d31_pC_N, d32_pC_N))
        return dict(zip(self.electrodes, charges.tolist(), strict=True))

    def charge_errors_pC(
        self, d31_pC_N: float, d32_pC_N: float, observable: str = "material"
    ) -> dict[str, float]:
        """Return the estimated errors of `charges_pC` in pC by electrode; NaN if not known.

        Parameters
        ----------
        d31_pC_N, d32_pC_N : float
            Piezoelectric coefficients.
        observable : str, optional
            Name of the observable; the errors are NaN if it is not the scene's.
        """
        errors = self.integrals_by(observable).charge_errors((d31_pC_N, d32_pC_N))
        return dict(zip(self.electrodes, errors.tolist(), strict=True))

    def _make_integrals(
        self, values: list[list[float]] | None, errors: list[list[float]] | None
    ) -> StressIntegrals:
        """Make stress integrals; values or errors that are None or empty become NaN."""
        unknown = np.full((len(self.electrodes), 2), np.nan)
        return StressIntegrals(
            values=np.array(values) if values else unknown,
            errors=np.array(errors) if errors else unknown,
        )


class Store:
    """Records by scene in an SQLite file, which is made if it does not exist.

    Several processes may use one file. Records can be read from a file without write permission.

    Parameters
    ----------
    path : Path
        Path of the file.

    Raises
    ------
    StoreError
        If the file cannot be opened, is damaged, or is not a store of this version.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        with self._convert_store_errors():
            name = os.path.abspath(path)
            self._rows = sqlite3.connect(name, timeout=LONGEST_WAIT, isolation_level=None)
        try:
            self._prepare_table()
        except BaseException:
            self._rows.close()
            raise

    def _prepare_table(self) -> None:
        """Make the table in an empty file; raise `StoreError` if the file is damaged."""
        if self._is_empty():
            with self._run_transaction():
                if self._is_empty():  # and no other process has made the table meanwhile
                    self._fetch_first_row(
                        "CREATE TABLE records (key PRIMARY KEY, record) WITHOUT ROWID"
                    )
                    self._fetch_first_row(_SIGN)
        state = self._fetch_first_row("PRAGMA integrity_check(1)")
        if state != ("ok",):
            raise StoreError(f"{self._path}: damaged: {state[0]}; {_REMOVE}")

    def _is_empty(self) -> bool:
        """Return whether the file is empty; raise `StoreError` if it is not a store."""
        # in this order, because another process may create the store between the two queries
        (tables,) = self._fetch_first_row("SELECT count(*) FROM sqlite_master")
        (kind,) = self._fetch_first_row("PRAGMA application_id")
        if kind != APPLICATION_ID and (kind or tables):
            raise StoreError(f"{self._path}: not a store of this version of pvdf_fem; {_REMOVE}")
        return not kind

    def get(self, scene: Scene) -> Record | None:
        """Return the record of a scene; None if there is none, or if its row is damaged."""
        fields = self.get_value(make_record_key(scene))
        if fields is None:
            return None
        for name in ("electrodes", "warnings"):
            fields[name] = tuple(fields[name])
        return Record(**fields)

    def get_value(self, key: str) -> Any:
        """Return the value under a key; None if there is none, or if its row is damaged."""
        row = self._fetch_first_row("SELECT record FROM records WHERE key = ?", key)
        if not row:
            return None
        try:
            stored_key, value = json.loads(zlib.decompress(row[0]))
        except (zlib.error, TypeError):  # the checksum of zlib, or a number in place of bytes
            return None
        return value if stored_key == key else None

    def __contains__(self, scene: Scene) -> bool:
        return self.get(scene) is not None

    def put(self, records: Iterable[tuple[Scene, Record]]) -> None:
        """Store the records of scenes in a single transaction; existing ones are replaced."""
        values = {}
        for scene, record in records:
            values[make_record_key(scene)] = vars(record)
        self.put_values(values)

    def put_values(self, values: Mapping[str, Any]) -> None:
        """Store JSON values under their keys in a single transaction; replace existing ones."""
        with self._run_transaction():
            for key, value in values.items():
                text = zlib.compress(json.dumps([key, value]).encode())
                self._fetch_first_row("INSERT OR REPLACE INTO records VALUES (?, ?)", key, text)

    def require_writable(self) -> None:
        """Raise `StoreError` if the file cannot be written; called before a solve."""
        self._fetch_first_row(_SIGN)  # writes the application id that the file has already

    @contextmanager
    def _run_transaction(self) -> Iterator[None]:
        """Run the block in a transaction: commit it at the end, or roll it back on an error."""
        with self._convert_store_errors(), self._rows:
            self._fetch_first_row("BEGIN IMMEDIATE")
            yield

    def _fetch_first_row(self, query: str, *values: str | bytes) -> Any:
        """Execute a query, and return the first row of its result; None if it has no rows."""
        with self._convert_store_errors():
            return self._rows.execute(query, values).fetchone()

    @contextmanager
    def _convert_store_errors(self) -> Iterator[None]:
        """Raise errors of SQLite and of the file system in the block as `StoreError`."""
        try:
            yield
        except (sqlite3.Error, OSError, UnicodeDecodeError) as error:
            code = getattr(error, "sqlite_errorcode", 0)
            if isinstance(error, UnicodeDecodeError):  # SQLite's texts may be damaged, too
                code = sqlite3.SQLITE_CORRUPT
            elif isinstance(error, sqlite3.ProgrammingError):
                code = sqlite3.SQLITE_MISUSE
            primary_code = code & 0xFF  # the upper bytes distinguish its variants
            advice = _ADVICE.get(primary_code, "name another file or see to its disk")
            raise StoreError(f"{self._path}: {error}; {advice}") from error

    def close(self) -> None:
        """Close the file."""
        with self._convert_store_errors():
            self._rows.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
