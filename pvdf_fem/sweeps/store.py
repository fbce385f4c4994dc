"""Records of solved scenes, in an SQLite file that survives a killed process.

Each scene has a row. The row's key is a hash of what is solved of the scene, with its numerics and
the content of its files, and of the source of every module that numbers depend on, so that results
of older code are never taken for new ones.
Rows are committed as soon as their scenes are solved, those of one solve together.

Programs that use a store at the same time claim a solve before they begin it. A claim is a lock on
a byte of a file beside the store, so the system ends it together with its process.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import sqlite3
import sys
import time
import zlib
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any, Self

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.charges.forces import Forces
from pvdf_fem.files import FileError, give_permissions
from pvdf_fem.film.loads.profiles import pinned
from pvdf_fem.scene.affects import Affects, affecting
from pvdf_fem.scene.scene import Scene

if sys.platform != "win32":
    import fcntl

# SQLite's application id of our files: "pvdf" in ASCII.
APPLICATION_ID = 0x70766466
# Version of the tables in our files.
SCHEMA = 2
# Longest wait in s for other programs that write to the file.
LONGEST_WAIT = 60.0
# Pause in s between attempts to open a file that other programs are making.
PAUSE = 0.01
# Folders of modules, and packages, on which the numbers of a record depend.
NUMERICAL_FOLDERS = ("scene", "mesh", "film", "charges", "solvers", "solution", "sweeps")
NUMERICAL_PACKAGES = ("gmsh", "numpy", "scikit-fem", "scipy")


_REMOVE = "name another file or remove this one"
_ADVICE = {
    sqlite3.SQLITE_CORRUPT: _REMOVE,
    sqlite3.SQLITE_NOTADB: _REMOVE,
    sqlite3.SQLITE_BUSY: "wait until no other program writes to it",
    sqlite3.SQLITE_READONLY: "make it writable, or name another file",
}


class StoreError(FileError):
    """A file cannot serve as a store; the text names the file and says what to do."""


@dataclass(frozen=True)
class Record:
    """A solution without its fields."""

    status: str
    reason: str
    electrodes: tuple[str, ...]  #: Names of the electrodes.
    #: For each observable the forces X, Y in N of each electrode; d31 X + d32 Y is its charge.
    #: Empty for a scene that has not converged.
    forces: dict[str, list[list[float]]] = field(default_factory=dict)
    #: Estimated errors of the forces by the observable of the scene.
    force_errors: dict[str, list[list[float]]] = field(default_factory=dict)
    deflection_max_mm: float = 0.0
    warnings: tuple[str, ...] = ()
    seconds: float = 0.0
    #: Forces by the scene's observable on the untouched film, and their errors; empty if not known.
    rest_forces: list[list[float]] = field(default_factory=list)
    rest_force_errors: list[list[float]] = field(default_factory=list)

    @property
    def at_rest(self) -> Forces:
        """`rest_forces` with their errors."""
        return Forces(np.array(self.rest_forces), np.array(self.rest_force_errors))

    @property
    def converged(self) -> bool:
        """Whether there are charges."""
        return self.status == "converged"

    def charges_pC(
        self, d31_pC_N: float, d32_pC_N: float, observable: str = "material"
    ) -> dict[str, float]:
        """Charges in pC by electrode; raises `KeyError` for a record without charges."""
        return self._by_electrode(self.forces_by(observable).charges((d31_pC_N, d32_pC_N)))

    def charge_errors_pC(
        self, d31_pC_N: float, d32_pC_N: float, observable: str = "material"
    ) -> dict[str, float]:
        """Estimated errors of `charges_pC`; NaN for an observable other than the scene's."""
        return self._by_electrode(self.forces_by(observable).charge_errors((d31_pC_N, d32_pC_N)))

    def forces_by(self, observable: str) -> Forces:
        """The electrodes' forces; their errors are NaN for an observable other than the scene's."""
        values = np.reshape(self.forces[observable], (-1, 2))
        errors = self.force_errors.get(observable, np.full_like(values, np.nan))
        return Forces(values, np.reshape(errors, (-1, 2)))

    def _by_electrode(self, values: Array) -> dict[str, float]:
        return dict(zip(self.electrodes, values.tolist(), strict=True))

    def charge_pC(
        self,
        electrode: str,
        observable: str = "material",
        d31_pC_N: float = 8.0,
        d32_pC_N: float = 8.0,
    ) -> float:
        """Charge in pC of one electrode; NaN for a record without charges."""
        known = observable in self.forces
        return self.charges_pC(d31_pC_N, d32_pC_N, observable)[electrode] if known else np.nan

    def charge_error_pC(
        self, electrode: str, observable: str, d31_pC_N: float = 8.0, d32_pC_N: float = 8.0
    ) -> float:
        """Estimated error of `charge_pC`; NaN where there is none."""
        known = observable in self.forces
        return self.charge_errors_pC(d31_pC_N, d32_pC_N, observable)[electrode] if known else np.nan


class Store:
    """Records by scene, in a file, which is made if there is none. Several processes may use one
    file. Where it cannot be written it is opened for reading. `code` is a hash of the code outside
    this package that makes the records, if there is any. Raises `StoreError` if the file is
    damaged, or is no store of this version."""

    def __init__(self, path: Path, code: str = "") -> None:
        self._path, self._code = path, code
        self._claims: int | None = None
        if str(path) == ":memory:":
            raise StoreError(f"{path}: is no file and would be lost; name a file")
        try:
            self._connect("")
        except StoreError as error:
            unwritable = _number(error) in (sqlite3.SQLITE_READONLY, sqlite3.SQLITE_CANTOPEN)
            if not (unwritable and path.is_file()):
                raise
            try:
                self._connect("?mode=ro")
            except StoreError:  # nor can SQLite's files beside it be made
                self._connect("?immutable=1")

    def _connect(self, mode: str) -> None:
        self.read_only = bool(mode)
        name = Path(os.path.abspath(self._path)).as_uri() + mode
        try:
            self._rows = sqlite3.connect(name, timeout=LONGEST_WAIT, isolation_level=None, uri=True)
        except sqlite3.Error as error:
            raise self._error(error) from error
        try:
            self._open_among_others()
        except BaseException:
            self._rows.close()
            raise

    def _open_among_others(self) -> None:
        """Open the file; SQLite itself does not wait where two programs make it at once."""
        latest = time.monotonic() + LONGEST_WAIT
        while True:
            try:
                return self._open()
            except StoreError as error:
                if _number(error) != sqlite3.SQLITE_BUSY or time.monotonic() > latest:
                    raise
            if self._rows.in_transaction:
                self._execute("ROLLBACK")
            time.sleep(PAUSE)

    def _open(self) -> None:
        self._execute("BEGIN")  # another process may make the store at this moment
        (kind,) = self._execute("PRAGMA application_id")
        (schema,) = self._execute("PRAGMA user_version")
        (tables,) = self._execute("SELECT count(*) FROM sqlite_master")
        self._execute("COMMIT")
        used = tables or kind or schema or self.read_only
        if used and (kind, schema) != (APPLICATION_ID, SCHEMA):
            raise StoreError(f"{self._path}: not a store of pvdf_fem, version {SCHEMA}; {_REMOVE}")
        state = self._execute("PRAGMA quick_check(1)")
        if state != ("ok",):
            raise StoreError(f"{self._path}: damaged: {state[0]}; {_REMOVE}")
        if self.read_only:
            return
        self._execute("PRAGMA journal_mode = WAL")
        self._execute("BEGIN IMMEDIATE")
        self._execute(f"PRAGMA application_id = {APPLICATION_ID}")
        self._execute(f"PRAGMA user_version = {SCHEMA}")
        self._execute("CREATE TABLE IF NOT EXISTS records (key TEXT PRIMARY KEY, record TEXT)")
        self._execute("COMMIT")

    def get(self, scene: Scene) -> Record | None:
        """The record of a scene; None if there is none, or if its row is damaged."""
        text = self._text(scene)
        if text is None:
            return None
        fields = json.loads(text)
        return Record(**fields | {name: tuple(fields[name]) for name in ("electrodes", "warnings")})

    def __contains__(self, scene: Scene) -> bool:
        return self._text(scene) is not None

    def _text(self, scene: Scene) -> str | None:
        name = self._code + key(scene)
        row = self._execute("SELECT record FROM records WHERE key = ?", name)
        text = row[0][8:] if row and isinstance(row[0], str) else ""
        return text if text and row[0] == _sum(name, text) + text else None

    def put(self, records: Iterable[tuple[Scene, Record]]) -> None:
        """Add the records of scenes, all of them or none."""
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
        """The first row of a query's result."""
        try:
            return self._rows.execute(query, values).fetchone()
        except (sqlite3.Error, UnicodeDecodeError) as error:  # SQLite's texts may be damaged too
            raise self._error(error) from error

    def _error(self, error: Exception) -> StoreError:
        if isinstance(error, sqlite3.ProgrammingError):
            reason = "belongs to another thread; open one in each"
            if "closed" in str(error):
                reason = "is closed; open another one on the file"
            return StoreError(f"{self._path}: this Store {reason}")
        damaged = isinstance(error, UnicodeDecodeError)
        code = sqlite3.SQLITE_CORRUPT if damaged else getattr(error, "sqlite_errorcode", 0)
        advice = _ADVICE.get(code & 0xFF, "name another file or see to its disk")
        return StoreError(f"{self._path}: {error}; {advice}")

    def claim(self, solve: str) -> bool:
        """Claim a solve for this process; False if another process has claimed it. Raises
        `StoreError` when the file can only be read: the solve's records would be lost."""
        if self.read_only:
            advice = _ADVICE[sqlite3.SQLITE_READONLY]
            raise StoreError(f"{self._path}: can only be read, and scenes are missing; {advice}")
        if sys.platform == "win32":
            return True
        digest = hashlib.sha256((self._code + code_version() + solve).encode()).hexdigest()
        try:
            if self._claims is None:
                self._claims = os.open(self._claims_path, os.O_RDWR | os.O_CREAT, 0o666)
                give_permissions(self._path, self._claims_path)
            fcntl.lockf(self._claims, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, int(digest[:15], 16))
        except OSError as error:
            if self._claims is None or error.errno not in (errno.EAGAIN, errno.EACCES):
                raise self._error(error) from error
            return False
        return True

    @property
    def _claims_path(self) -> Path:
        return Path(f"{os.path.realpath(self._path)}-claims")

    def end_claims(self) -> None:
        """End all claims of this process."""
        if self._claims is not None and sys.platform != "win32":
            with suppress(OSError):  # when another process has claims
                fcntl.lockf(self._claims, fcntl.LOCK_EX | fcntl.LOCK_NB)
                self._claims_path.unlink(missing_ok=True)
            os.close(self._claims)
            self._claims = None

    def close(self) -> None:
        """Close the file."""
        self.end_claims()
        try:
            self._rows.close()
        except sqlite3.Error as error:
            raise self._error(error) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _number(error: StoreError) -> int:
    """SQLite's primary result code of an error; zero if it is not SQLite's."""
    return getattr(error.__cause__, "sqlite_errorcode", 0) & 0xFF


def _sum(name: str, text: str) -> str:
    """Checksum of a row in eight characters; SQLite does not notice a damaged row itself."""
    return f"{zlib.crc32((name + text).encode()):08x}"


def key(scene: Scene, folders: tuple[str, ...] = NUMERICAL_FOLDERS) -> str:
    """Hash of what is solved of a scene, and of the code in some folders that solves it."""
    (scene,) = pinned([scene])
    # with coupling, amplifiers and the permittivity act on the film
    effects = [*Affects] if scene.film.coupling else set(Affects) - {Affects.INSTRUMENT}
    solved = repr(affecting(scene, *effects))
    return hashlib.sha256((code_version(folders) + solved).encode()).hexdigest()


@cache
def code_version(folders: tuple[str, ...] = NUMERICAL_FOLDERS) -> str:
    """Hash of the modules in some folders of the package and of the libraries' versions."""
    digest = hashlib.sha256()
    for name in NUMERICAL_PACKAGES:
        digest.update(f"{name} {metadata.version(name)}\n".encode())
    for module in modules_in(folders):
        digest.update(module.read_bytes())
    return digest.hexdigest()


def modules_in(folders: tuple[str, ...] = NUMERICAL_FOLDERS) -> list[Path]:
    """The modules in some folders of the package, and those that all folders share."""
    package = Path(__file__).parents[1]
    modules = (module for folder in folders for module in package.joinpath(folder).rglob("*.py"))
    return [package / "arrays.py", *sorted(modules)]
