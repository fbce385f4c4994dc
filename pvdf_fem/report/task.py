"""Tasks: computations of a report besides charges, such as modes, timings and located touches.

A task is a frozen dataclass in the file of its kind. Tasks run in the processes that solve scenes.
Their rows are kept in the report's folder, so that a stopped report goes on. Rows are kept under a
hash of the task's class and fields, of the package's modules, and of the modules in the folder of
the task's module: when any of these changes, the task runs again.
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

from pvdf_fem.batch.keys import hash_code
from pvdf_fem.batch.store import Store
from pvdf_fem.batch.workers import WorkerDied, run_on_processes
from pvdf_fem.film.loads.profiles import pin_profile_files
from pvdf_fem.mesh.gmsh_libraries import GmshMissingError
from pvdf_fem.scene.scene import Scene

#: Folders of the package on whose code no task depends.
_OTHER_FOLDERS = ("cli", "explore", "view")
_FILE_PREFIX = "pvdf_fem.report.own_"  #: Begins the names of modules that are run from a file.

Rows: TypeAlias = list[dict[str, Any]]


@dataclass(frozen=True)
class Task(ABC):
    """A computation besides charges of scenes.

    Fields are plain values, tuples, scenes, and dataclasses of these.
    """

    @abstractmethod
    def run(self) -> Rows:
        """Return rows of plain values: str, float, int, bool, None, and lists.

        The report shows the text of an exception in place of the figure.
        """

    def __reduce__(self) -> tuple[Any, ...]:
        # Pickle reads the fields last: another process knows the classes of their values only
        # after it has run the task's file.
        cls = type(self)
        arguments = (cls.__module__, cls.__qualname__, inspect.getfile(cls))
        return _make_empty_task, arguments, vars(self)


def _make_empty_task(module: str, name: str, path: str) -> Any:
    """Return a task without its fields, in a process that may not have run the task's file.

    Parameters
    ----------
    module, name : str
        Module and qualified name of the task's class.
    path : str
        File of the class.
    """
    if module.startswith(_FILE_PREFIX) and module not in sys.modules:
        run_module(Path(path))
    cls = attrgetter(name)(import_module(module))
    return cls.__new__(cls)


def run_module(path: Path) -> ModuleType:
    """Run a Python file and return its module.

    The name of the module contains a hash of the file's path and text, so that an edited file is a
    new module. Exceptions of the file are passed on.
    """
    digest = hashlib.sha256(bytes(path.resolve()) + path.read_bytes()).hexdigest()[:16]
    name = f"{_FILE_PREFIX}{path.stem}_{digest}"
    loader = SourceFileLoader(name, str(path.resolve()))
    spec = spec_from_file_location(name, path, loader=loader)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[name] = module  # where pydantic looks for names in annotations
    spec.loader.exec_module(module)
    return module


def compute_key(task: Task) -> str:
    """Return a hash of a task's class, fields and code."""
    with np.printoptions(threshold=sys.maxsize, floatmode="unique"):
        text = _format_value(task)
    cls = type(task)
    code = _hash_code(cls.__module__, inspect.getfile(cls))
    return hashlib.sha256((code + text).encode()).hexdigest()


def _format_value(value: Any) -> str:
    """Return a text that differs wherever two values differ, unlike the `repr` of a scene."""
    if isinstance(value, Scene):
        return pin_profile_files([value])[0].model_dump_json()
    if isinstance(value, tuple | list):
        return f"({', '.join(map(_format_value, value))})"
    if is_dataclass(value) and not isinstance(value, type):
        texts = []
        for field in fields(value):
            texts.append(f"{field.name}={_format_value(getattr(value, field.name))}")
        return f"{type(value).__qualname__}({', '.join(texts)})"
    return repr(value)


@cache
def _hash_code(module: str, path: str) -> str:
    """Return a hash of the package's modules and of the modules in the folder of a file.

    The cache needs the name of the file's module, which changes with its text (`run_module`).
    """
    package = Path(__file__).parents[1]
    folders = [folder.name for folder in package.iterdir() if folder.is_dir()]
    folders = sorted(name for name in folders if name not in _OTHER_FOLDERS)
    digest = hashlib.sha256(hash_code(tuple(folders)).encode())
    for file in sorted(Path(path).parent.glob("*.py")):
        digest.update(file.read_bytes())
    return digest.hexdigest()


def run_tasks(
    tasks: Mapping[str, Task], store: Store, processes: int | None = None
) -> Iterator[tuple[str, Rows | WorkerDied]]:
    """Run tasks and keep their rows.

    Parameters
    ----------
    tasks : mapping of str to Task
        Tasks by key (`compute_key`).
    store : Store
        Keeps the rows.
    processes : int, optional
        Number of processes, by default one per core.

    Yields
    ------
    key : str
        Key of a task, in order of completion.
    rows : list of dict, or WorkerDied
        Its rows, or why there are none: the task raised, or killed its process.
    """
    keys = list(tasks)
    for number, rows in run_on_processes(_run_task, enumerate(tasks.values()), processes):
        if not isinstance(rows, WorkerDied):
            store.put_values({keys[number]: rows})
        yield keys[number], rows


def _run_task(task: Task) -> Rows | WorkerDied:
    """Return the rows of a task in the form of the store, or the reason why there are none."""
    try:
        # as the store returns them, so that new and kept rows give equal pages
        return json.loads(json.dumps(task.run(), default=lambda number: number.item()))
    except GmshMissingError:  # no task can be done
        raise
    except Exception as error:  # must not end the other tasks
        traceback.print_exc(file=sys.stderr)
        return WorkerDied(f"{type(error).__name__}: {error}")
