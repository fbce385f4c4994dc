"""Tasks: computations of a report besides charges, such as modes, timings and located touches.

A task is a frozen dataclass in the file of its kind. Tasks run in worker processes. Their rows are
saved in the report's folder, so that an interrupted report can be continued. The key of the rows is
a hash of the task's class and fields, of the package's modules, and of the modules in the folder of
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

#: Folders of the package whose code does not influence tasks.
_OTHER_FOLDERS = ("cli", "explore", "view")
_FILE_PREFIX = "pvdf_fem.report.own_"  #: Prefix of the names of modules that are run from a file.

Rows: TypeAlias = list[dict[str, Any]]


@dataclass(frozen=True)
class Task(ABC):
    """A computation of a report besides the charges of scenes.

    Fields are plain values, scenes, and tuples or dataclasses of these.
    """

    @abstractmethod
    def run(self) -> Rows:
        """Compute the rows of the task. Subclasses implement this method.

        Values are str, float, int, bool, None, and lists of these. If an exception is raised, the
        report shows its text in place of the figure.
        """

    def __reduce__(self) -> tuple[Any, ...]:
        # Pickle creates the task without its fields first: another process knows the classes of
        # the fields' values only after it has run the task's file.
        cls = type(self)
        arguments = (cls.__module__, cls.__qualname__, inspect.getfile(cls))
        return _make_task_without_fields, arguments, vars(self)


def _make_task_without_fields(module: str, name: str, path: str) -> Any:
    """Create a task whose fields are not yet set, for unpickling in another process.

    Runs the task's file first if its module comes from a file that this process has not run.

    Parameters
    ----------
    module, name : str
        Module and qualified name of the task's class.
    path : str
        Python file that defines the class.

    Returns
    -------
    Task
        Pickle sets the fields afterwards.
    """
    if module.startswith(_FILE_PREFIX) and module not in sys.modules:
        run_module(Path(path))
    cls = attrgetter(name)(import_module(module))
    return cls.__new__(cls)


def run_module(path: Path) -> ModuleType:
    """Run a Python file and return its module.

    The name of the module contains a hash of the file's path and text, so that an edited file
    becomes a new module. The module is added to `sys.modules`. Exceptions of the file propagate.
    """
    digest = hashlib.sha256(bytes(path.resolve()) + path.read_bytes()).hexdigest()[:16]
    name = f"{_FILE_PREFIX}{path.stem}_{digest}"
    loader = SourceFileLoader(name, str(path.resolve()))
    spec = spec_from_file_location(name, path, loader=loader)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[name] = module  # pydantic resolves the names in annotations there
    spec.loader.exec_module(module)
    return module


def compute_key(task: Task) -> str:
    """Return a hash of a task's class, fields and code, the key of its rows in the store."""
    with np.printoptions(threshold=sys.maxsize, floatmode="unique"):
        text = _format_value(task)
    cls = type(task)
    code = _hash_code(cls.__module__, inspect.getfile(cls))
    return hashlib.sha256((code + text).encode()).hexdigest()


def _format_value(value: Any) -> str:
    """Return a text that differs for different values.

    Scenes are written as JSON with the content of their profile files, because their `repr` does
    not contain all values.
    """
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

    `module` only serves as a key of the cache: the module name of an edited file changes with the
    file's text (`run_module`).
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
    """Run tasks in worker processes, save their rows to the store, and yield them.

    Parameters
    ----------
    tasks : mapping of str to Task
        Tasks by key (`compute_key`).
    store : Store
        Saves the rows. Failures are not saved.
    processes : int, optional
        Number of processes. Default: one per core.

    Yields
    ------
    key : str
        Key of a task, in order of completion.
    rows : list of dict, or WorkerDied
        Rows of the task, or the reason of its failure: it raised an exception or killed its
        process.
    """
    keys = list(tasks)
    for number, rows in run_on_processes(_run_task, enumerate(tasks.values()), processes):
        if not isinstance(rows, WorkerDied):
            store.put_values({keys[number]: rows})
        yield keys[number], rows


def _run_task(task: Task) -> Rows | WorkerDied:
    """Run a task and return its rows as plain JSON values, or the reason of its failure."""
    try:
        # converted as by the store, so that new and stored rows give equal pages
        return json.loads(json.dumps(task.run(), default=lambda number: number.item()))
    except GmshMissingError:  # without gmsh the other tasks would fail, too
        raise
    except Exception as error:  # one task must not stop the others
        traceback.print_exc(file=sys.stderr)
        return WorkerDied(f"{type(error).__name__}: {error}")
