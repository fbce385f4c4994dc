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
import sys
import traceback
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from functools import cache
from importlib import import_module
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_file_location
from operator import attrgetter
from pathlib import Path
from types import ModuleType
from typing import Any, TypeAlias

import numpy as np

from pvdf_fem.film.loads.profiles import pinned
from pvdf_fem.mesh.gmsh_libraries import GmshMissingError
from pvdf_fem.scene.scene import Scene
from pvdf_fem.sweeps.store import Store, code_version
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
        kind = type(self)
        # fields are read last: another process knows their classes once it has run the file
        return _blank, (kind.__module__, kind.__qualname__, inspect.getfile(kind)), vars(self)


def _blank(module: str, name: str, path: str) -> Any:
    """A task without its fields, in a process that may not have run the task's file."""
    if module.startswith(_OWN) and module not in sys.modules:
        module_of(Path(path))
    kind = attrgetter(name)(import_module(module))
    return kind.__new__(kind)


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


def done(
    tasks: Mapping[str, Task], store: Store, processes: int
) -> Iterator[tuple[str, Rows | Died]]:
    """Keys and rows of tasks in the order of completion; the rows join the store. `Died` stands for
    the rows of a task that raised, or killed its process."""
    names = list(tasks)
    for number, found in on_processes(_rows_of, enumerate(tasks.values()), processes):
        if not isinstance(found, Died):
            store.keep({names[number]: found})
        yield names[number], found


def _rows_of(task: Task) -> Rows | Died:
    try:
        # as the store gives them back: a fresh result makes the page that a kept one makes
        return json.loads(json.dumps(task.run(), default=lambda number: number.item()))
    except GmshMissingError:  # no task can be done
        raise
    except Exception as error:  # must not end the other tasks
        traceback.print_exc(file=sys.stderr)
        return Died(f"{type(error).__name__}: {error}")
