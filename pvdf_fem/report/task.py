"""Computations beside charges: modes, timings, located touches.

A task is a frozen dataclass in the file of its kind. Tasks run in the processes that solve scenes.
Rows are kept in the report's folder: a stopped report goes on. The key of a result is a hash over
the task's class and fields, the package's modules, and the modules beside the task's module: no
result outlives its code.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import sys
import traceback
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from importlib import import_module
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_file_location
from operator import attrgetter
from pathlib import Path
from types import ModuleType
from typing import Any, TypeAlias

import numpy as np

from pvdf_fem.batch.store import Store, hash_code
from pvdf_fem.batch.workers import WorkerDied, run_on_processes
from pvdf_fem.film.loads.profiles import pin_profile_files
from pvdf_fem.mesh.gmsh_libraries import GmshMissingError
from pvdf_fem.scene.scene import Scene

#: Folders with modules on which no task's rows depend.
_ASIDE = ("cli", "explore", "view")
_OWN = "pvdf_fem.report.own_"  #: Begins the names of modules that are run from a file.

Rows: TypeAlias = list[dict[str, Any]]


@dataclass(frozen=True)
class Task(ABC):
    """Something to compute besides charges of scenes. Fields are plain values, tuples, scenes, and
    further task classes."""

    @abstractmethod
    def run(self) -> Rows:
        """Rows with plain values: str, float, int, bool, None, and lists. An exception is the
        reason shown in place of the figure."""

    def __reduce__(self) -> tuple[Any, ...]:
        kind = type(self)
        # fields are read last: another process knows their classes once it has run the file
        return _blank, (kind.__module__, kind.__qualname__, inspect.getfile(kind)), vars(self)


def _blank(module: str, name: str, path: str) -> Any:
    """A task without its fields, in a process that may not have run the task's file."""
    if module.startswith(_OWN) and module not in sys.modules:
        run_module(Path(path))
    kind = attrgetter(name)(import_module(module))
    return kind.__new__(kind)


def run_module(path: Path) -> ModuleType:
    """The module from running a Python file. Its name has a hash of its text: an edited file is a
    new module. Raises what the file raises."""
    digest = hashlib.sha256(bytes(path.resolve()) + path.read_bytes()).hexdigest()[:16]
    name = f"{_OWN}{path.stem}_{digest}"
    spec = spec_from_file_location(name, path, loader=SourceFileLoader(name, str(path.resolve())))
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[name] = module  # where pydantic looks for names in annotations
    spec.loader.exec_module(module)
    return module


def compute_key(task: Task) -> str:
    """Hash over a task's class, fields and code."""
    with np.printoptions(threshold=sys.maxsize, floatmode="unique"):
        text = _text(task)
    code = _code_of(type(task).__module__, inspect.getfile(type(task)))
    return hashlib.sha256((code + text).encode()).hexdigest()


def _text(value: Any) -> str:
    """All that a value holds; the representation of a scene is a summary."""
    if isinstance(value, Scene):
        return pin_profile_files([value])[0].model_dump_json()
    if isinstance(value, tuple | list):
        return f"({', '.join(map(_text, value))})"
    if is_dataclass(value) and not isinstance(value, type):
        held = (f"{field.name}={_text(getattr(value, field.name))}" for field in fields(value))
        return f"{type(value).__qualname__}({', '.join(held)})"
    return repr(value)


@cache
def _code_of(name: str, path: str) -> str:
    """Hash over the package's modules and the modules beside a module."""
    package = Path(__file__).parents[1]
    folders = sorted(of.name for of in package.iterdir() if of.is_dir() and of.name not in _ASIDE)
    digest = hashlib.sha256(hash_code(tuple(folders)).encode())
    for module in sorted(Path(path).parent.glob("*.py")):
        digest.update(module.read_bytes())
    return digest.hexdigest()


def run_tasks(
    tasks: Mapping[str, Task], store: Store, processes: int
) -> Iterator[tuple[str, Rows | WorkerDied]]:
    """Keys and rows of tasks in order of completion; the rows join the store. `WorkerDied` replaces the
    rows of a task that raised, or killed its process."""
    names = list(tasks)
    for number, found in run_on_processes(_rows_of, enumerate(tasks.values()), processes):
        if not isinstance(found, WorkerDied):
            store.keep({names[number]: found})
        yield names[number], found


def _rows_of(task: Task) -> Rows | WorkerDied:
    try:
        # in the store's form: fresh and kept results make equal pages
        return json.loads(json.dumps(task.run(), default=lambda number: number.item()))
    except GmshMissingError:  # no task can be done
        raise
    except Exception as error:  # must not end the other tasks
        traceback.print_exc(file=sys.stderr)
        return WorkerDied(f"{type(error).__name__}: {error}")
