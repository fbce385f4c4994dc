"""What a kind computes besides the charges of scenes: modes, a timing, touches located.

A task is a frozen dataclass in the file of its kind. Tasks run in the processes that solve scenes,
and their rows are kept in the report's folder, so that a report that was stopped goes on. The key
of a result is a hash of the task's class and fields, of the package's modules, and of the modules
beside the task's own, so that no result outlives the code that made it.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import sqlite3
import sys
import traceback
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass, fields, replace
from functools import cache
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any, Self, TypeAlias

import numpy as np

from pvdf_fem.files import FileError
from pvdf_fem.film.loads.profiles import pinned
from pvdf_fem.mesh.gmsh_libraries import GmshMissingError
from pvdf_fem.scene.scene import Scene
from pvdf_fem.sweeps.store import LONGEST_WAIT, code_version
from pvdf_fem.sweeps.workers import Died, on_processes

#: Folders of modules on which the rows of no task depend.
_ASIDE = ("cli", "explore", "output")
_OWN = "pvdf_fem.reporting.own_"  #: Begins the names of modules that are run from a file.

Rows: TypeAlias = list[dict[str, Any]]


@dataclass(frozen=True)
class Task(ABC):
    """Something to compute besides charges of scenes. Fields are plain values, tuples of them,
    scenes, and classes of the same kind."""

    @abstractmethod
    def run(self) -> Rows:
        """Rows of plain values: str, float, int, bool, None, and lists of them. An exception is
        the reason that stands in the place of the figure."""

    def __reduce__(self) -> tuple[Any, ...]:
        values = [getattr(self, field.name) for field in fields(self)]
        # read in this order: another process knows the class once it has run the file
        return _made, (_File.of(type(self)), type(self), values)


def _made(file: _File, kind: type[Task], values: list[Any]) -> Task:
    return kind(*values)


@dataclass(frozen=True)
class _File:
    """The module of a task, which a process that reads the task runs first."""

    name: str
    path: str

    @classmethod
    def of(cls, kind: type[Task]) -> Self:
        return cls(kind.__module__, inspect.getfile(kind))

    def __reduce__(self) -> tuple[Any, ...]:
        return _run_file, (self.name, self.path)


def _run_file(name: str, path: str) -> _File:
    if name.startswith(_OWN) and name not in sys.modules:
        module_of(Path(path))
    return _File(name, path)


def module_of(path: Path) -> ModuleType:
    """The module of a Python file, which is run. Its name has a hash of its text, so that an
    edited file is another module. Raises what the file raises."""
    digest = hashlib.sha256(bytes(path.resolve()) + path.read_bytes()).hexdigest()[:16]
    name = f"{_OWN}{path.stem}_{digest}"
    spec = spec_from_file_location(name, path, loader=SourceFileLoader(name, str(path.resolve())))
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[name] = module  # where pydantic looks for names in annotations
    spec.loader.exec_module(module)
    return module


def key(task: Task) -> str:
    """Hash of a task's class, its fields, and the code that it may run."""
    held = {field.name: getattr(task, field.name) for field in fields(task)}
    scenes = {name: pinned([value])[0] for name, value in held.items() if isinstance(value, Scene)}
    with np.printoptions(threshold=sys.maxsize, floatmode="unique"):
        text = f"{type(task).__qualname__} {replace(task, **scenes)!r}"
    code = _code_of(type(task).__module__, inspect.getfile(type(task)))
    return hashlib.sha256((code + text).encode()).hexdigest()


@cache
def _code_of(name: str, path: str) -> str:
    """Hash of the package's modules and of those beside a module."""
    package = Path(__file__).parents[1]
    folders = sorted(of.name for of in package.iterdir() if of.is_dir() and of.name not in _ASIDE)
    digest = hashlib.sha256(code_version(tuple(folders)).encode())
    for module in sorted(Path(path).parent.glob("*.py")):
        digest.update(module.read_bytes())
    return digest.hexdigest()


class Kept:
    """Rows of tasks by their keys, in an SQLite file, which is made if there is none."""

    def __init__(self, path: Path) -> None:
        self._path = path
        with self._opened() as file:
            file.execute("CREATE TABLE IF NOT EXISTS results (key PRIMARY KEY, rows)")

    def get(self, name: str) -> Rows | None:
        """The rows by a key; None if there are none."""
        with self._opened() as file:
            found = file.execute("SELECT rows FROM results WHERE key = ?", (name,)).fetchone()
        return None if found is None else json.loads(found[0])

    def put(self, name: str, text: str) -> None:
        """Keep rows, whose JSON is `text`."""
        with self._opened() as file:
            file.execute("INSERT OR REPLACE INTO results VALUES (?, ?)", (name, text))

    @contextmanager
    def _opened(self) -> Iterator[sqlite3.Connection]:
        how: Any = {"timeout": LONGEST_WAIT, "isolation_level": None}
        try:
            with closing(sqlite3.connect(self._path, **how)) as file:
                yield file
        except sqlite3.Error as error:
            advice = "remove the file, or name another folder"
            raise FileError(f"{self._path}: {error}; {advice}") from error


def done(
    tasks: Mapping[str, Task], kept: Kept, processes: int
) -> Iterator[tuple[str, Rows | Died]]:
    """Keys of tasks with their rows, as they come; the rows join `kept`. `Died` stands for the rows
    of a task that raised, or killed its process."""
    names = list(tasks)
    for number, found in on_processes(_text_of, enumerate(tasks.values()), processes):
        if isinstance(found, str):
            kept.put(names[number], found)
        yield names[number], found if isinstance(found, Died) else json.loads(found)


def _text_of(task: Task) -> str | Died:
    """The rows of a task as JSON, which says what a fresh result and a kept one have alike."""
    try:
        return json.dumps(task.run(), default=lambda number: number.item())
    except GmshMissingError:  # no task can be done
        raise
    except Exception as error:  # must not end the other tasks
        traceback.print_exc(file=sys.stderr)
        return Died(f"{type(error).__name__}: {error}")
