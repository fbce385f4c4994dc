"""Base classes for the kinds of figures and tables in a report.

A kind is a frozen class whose fields are its keys in a report script. It lists the scenes to solve
and the tasks to run, and draws the results on axes. The report solves the scenes, lays out the
page and writes the files.
"""

from __future__ import annotations

import inspect
from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from pydantic import Field

from pvdf_fem.arrays import Array
from pvdf_fem.report.data import Changes, Name, Readings
from pvdf_fem.report.results import NothingToShowError, ReportResults
from pvdf_fem.report.task import Task
from pvdf_fem.scene.changes import get_number
from pvdf_fem.scene.keys import Section
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, format_error, suggest
from pvdf_fem.view.figures import WIDTH_MM, get_figure, make_figure

QUICK_TOLERANCE = 1e-2  #: Finest tolerance of the scenes of a preview.
PROBE_POSITION_KEYS = ("probe.x_mm", "probe.y_mm")  #: Keys of the probe's position.


@contextmanager
def prefix_errors(key: str) -> Iterator[None]:
    """Raise errors about scenes within the context as `SceneError` with a script key in front."""
    try:
        yield
    except SceneError as error:
        raise SceneError([f"{key}: {problem}" for problem in error.problems]) from None
    except ValueError as error:
        raise SceneError([f"{key}: {error}"]) from None


@dataclass(frozen=True)
class Inputs:
    """The inputs that all figures and tables of a report share.

    Parameters
    ----------
    scene : Scene
        The report's scene.
    data : mapping of str to Readings
        The tables ``[data.NAME]`` of the script, by name.
    quick : bool
        Whether the report is a preview, of few scenes to a coarse tolerance.
    """

    scene: Scene
    data: Mapping[str, Readings]
    quick: bool = False

    def change_scene(self, *changes: Mapping[str, Any]) -> Scene:
        """Return a copy of the report's scene with changes.

        Parameters
        ----------
        *changes : mapping of str to value
            New values by dotted key. The mappings are applied one after the other.

        Returns
        -------
        Scene
            In a preview its tolerance is at least `QUICK_TOLERANCE`.

        Raises
        ------
        SceneError
            If the changed scene is invalid. The messages begin with the key `set`.
        """
        scene = self.scene
        with prefix_errors("set"):
            for table in changes:
                if table:
                    scene = scene.with_(**table)
        if self.quick and scene.numerics.tolerance < QUICK_TOLERANCE:
            scene = scene.with_(**{"numerics.tolerance": QUICK_TOLERANCE})
        return scene


@dataclass(frozen=True)
class Content:
    """The finished content of a figure or table.

    Parameters
    ----------
    caption : str
        Text below the figure.
    frame : DataFrame
        The data with all digits, for the CSV file.
    figure : Figure, optional
        The drawing.
    table : DataFrame, optional
        Cells of text for the table on the page.
    claim : str
        The main finding with its number, as a clause of the page's verdict. Empty if there is none.
    """

    caption: str
    frame: pd.DataFrame
    figure: Figure | None = None
    table: pd.DataFrame | None = None
    claim: str = ""


class Kind(Section):
    """Keys of every figure and table.

    `title` is the heading and `name` the name of the files. `set` changes the report's scene for
    this item: ``{ "film.d31_pC_N" = 18.0 }``. `data` names a table ``[data.NAME]``. `reading` is
    ``"total"`` for total charges or ``"change"`` for their change due to the touch; by default it
    agrees with the data. `summary` puts a preview of the figure at the top of the page. `full` has
    values of keys for reports made with ``--full``: ``{ touches = 2000 }``.
    """

    title: str = ""
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,59}$")] | None = None
    set: Changes = Field(default_factory=dict)
    data: Name | None = None
    reading: Literal["total", "change"] | None = None
    summary: bool = False
    full: dict[str, Any] = Field(default_factory=dict)

    stem: ClassVar[str] = "figure"  #: Default name of the files.
    rank: ClassVar[int] = 9  #: Priority for a preview at the top of the page; 0 comes first.

    # What to compute

    def list_changes(self) -> Sequence[Changes]:
        """Return the changes by dotted key for each scene to solve.

        Default: no scenes. Subclasses override this method or `list_scenes`.
        """
        return ()

    def list_scenes(self, inputs: Inputs) -> list[Scene]:
        """Return the scenes to solve.

        Default: one scene for each entry of `list_changes`, which is applied after `set`.

        Raises
        ------
        SceneError
            If keys of this kind are invalid. The exception lists all errors.
        """
        return [inputs.change_scene(self.set, changes) for changes in self.list_changes()]

    def list_tasks(self, inputs: Inputs) -> Sequence[Task]:
        """Return the tasks to run besides the scenes to solve.

        Default: no tasks. Subclasses override this method.

        Raises
        ------
        SceneError
            If keys of this kind are invalid. The exception lists all errors.
        """
        return ()

    # What to show

    def collect_data(self, inputs: Inputs, results: ReportResults) -> Any:
        """Collect the data to show after all scenes are solved and all tasks have run.

        Parameters
        ----------
        inputs : Inputs
            The report's scene and data.
        results : ReportResults
            Charges by scene, and rows by task.

        Returns
        -------
        DataFrame or object with a DataFrame attribute `frame`
            Default: the rows of the tasks. If these are empty, a row for each change and electrode
            with the changed keys, ``electrode``, ``computed_pC`` and ``error_pC``.

        Raises
        ------
        NothingToShowError
            If no scene has charges, or if a task failed.
        """
        rows = []
        for task in self.list_tasks(inputs):
            rows += results.get_rows(task)
        if rows:
            return pd.DataFrame(rows)
        return self._collect_charges(inputs, results)

    def make_figure(self, data: Any) -> Figure | None:
        """Return the figure of the data.

        Default: None, for a kind that shows only a table. `FigureKind` overrides this method.
        """
        return None

    def make_caption(self, data: Any) -> str:
        """Return the text below the figure. Default: the summary line of the class docstring."""
        documentation = inspect.getdoc(type(self)) or ""
        return documentation.partition("\n\n")[0].replace("\n", " ")

    def make_table(self, data: Any) -> pd.DataFrame | None:
        """Return the text cells of the table on the page.

        Default: None, for no table. Subclasses override this method.
        """
        return None

    def make_claim(self, data: Any) -> str:
        """Return the main finding with its number, as a clause of the page's verdict.

        Default: an empty string. Subclasses override this method.
        """
        return ""

    def compose(self, inputs: Inputs, results: ReportResults) -> Content:
        """Compose the caption, data, figure, table and claim of this item.

        Parameters
        ----------
        inputs : Inputs
            The report's scene and data.
        results : ReportResults
            Charges by scene, and rows by task.

        Returns
        -------
        Content

        Raises
        ------
        NothingToShowError
            If too many scenes have no charges, or if a task failed.
        """
        data = self.collect_data(inputs, results)
        return Content(
            caption=self.make_caption(data),
            frame=data if isinstance(data, pd.DataFrame) else data.frame,
            figure=self.make_figure(data),
            table=self.make_table(data),
            claim=self.make_claim(data),
        )

    # What kinds share

    def resolve_scene(self, inputs: Inputs) -> Scene:
        """Return the report's scene with the changes of `set`."""
        return inputs.change_scene(self.set)

    def find_readings(self, inputs: Inputs) -> Readings | None:
        """Return the readings that `data` names, or None if `data` is not set.

        A preview gets only some of the rows.

        Raises
        ------
        SceneError
            If the report has no table ``[data.NAME]`` with this name.
        """
        if self.data is None:
            return None
        if self.data not in inputs.data:
            names = list(inputs.data)
            advice = suggest(self.data, names) if names else "add a table [data.NAME]"
            reason = f"is not a data table of the report; {advice}"
            raise SceneError([format_error("data", self.data, reason)])
        readings = inputs.data[self.data]
        return readings.select_preview_rows() if inputs.quick else readings

    def resolve_reading(self, inputs: Inputs) -> str:
        """Return whether ``"total"`` charges are shown, or their ``"change"`` due to the touch.

        Without the key `reading` this agrees with the data. Without data it is ``"total"``.
        """
        if self.reading is not None:
            return self.reading
        readings = self.find_readings(inputs)
        return "total" if readings is None else readings.reading

    def describe_rings(self, inputs: Inputs) -> str:
        """Return the caption's sentence about the rings of the data; empty without data."""
        readings = self.find_readings(inputs)
        return "" if readings is None else f" Rings: {readings.source.what} charges."

    def require_rows(self, rows: Sequence[Any], lack: str) -> None:
        """Raise `SceneError` if `data` is set but none of its rows is shown.

        Parameters
        ----------
        rows : sequence
            The rows of `data` that are shown.
        lack : str
            Text after "has no row", such as "of the scene within the reach".
        """
        if self.data is not None and not rows:
            reason = f"has no row {lack}; change the data or `set`"
            raise SceneError([format_error("data", self.data, reason)])

    def _collect_charges(self, inputs: Inputs, results: ReportResults) -> pd.DataFrame:
        """Collect a row for each change and electrode, with the changed keys and the charge."""
        reading = self.resolve_reading(inputs)
        frames = []
        for changes, scene in zip(self.list_changes(), self.list_scenes(inputs), strict=True):
            names = [electrode.name for electrode in scene.electrode_list]
            frame = results.make_table([scene], names, reading)
            frame = frame[["electrode", "computed_pC", "error_pC"]]
            keys = {key: [value] * len(names) for key, value in changes.items()}
            frames.append(pd.concat([pd.DataFrame(keys), frame], axis=1))
        if not frames:
            raise NothingToShowError(
                f"list_changes and list_scenes of {type(self).__name__} give no scene to solve"
            )
        data = pd.concat(frames, ignore_index=True)
        if not data.computed_pC.notna().any():
            raise NothingToShowError("none of the scenes has charges")
        return data


class FigureKind(Kind):
    """Base class of kinds that draw their data on axes."""

    size_mm: ClassVar[tuple[float, float]] = (WIDTH_MM, 80.0)  #: Of a figure with one panel.

    @abstractmethod
    def draw(self, data: Any, axes: Any) -> None:
        """Draw the data on the axes. Subclasses implement this method.

        Parameters
        ----------
        data : DataFrame or object
            Return value of `collect_data`.
        axes : Axes or sequence of Axes
            Return value of `make_axes`.
        """

    def make_axes(self, data: Any) -> Any:
        """Return the empty axes of a new figure.

        Default: one `Axes`. Subclasses may return nested sequences of `Axes`.
        """
        return make_figure(*self.size_mm).subplots()

    def make_figure(self, data: Any) -> Figure:
        """Return a new figure with the data drawn on it."""
        axes = self.make_axes(data)
        self.draw(data, axes)
        first = axes
        while not isinstance(first, Axes):
            first = first[0]
        return get_figure(first)


class ElectrodeKind(FigureKind):
    """Base class of kinds with a key `electrodes`, by default all electrodes of the scene."""

    electrodes: Annotated[tuple[Name, ...], Field(min_length=1)] | None = None

    def resolve_electrodes(self, scene: Scene) -> tuple[str, ...]:
        """Return the names of the electrodes to show.

        Raises
        ------
        SceneError
            If names are unknown or repeated.
        """
        names = [electrode.name for electrode in scene.electrode_list]
        if self.electrodes is None:
            return tuple(names)
        problems = []
        for name in self.electrodes:
            if name not in names:
                reason = f"is not an electrode of the scene; {suggest(name, names)}"
                problems.append(format_error("electrodes", name, reason))
        if len(set(self.electrodes)) < len(self.electrodes):
            reason = "has a name twice; remove one"
            problems.append(format_error("electrodes", list(self.electrodes), reason))
        if problems:
            raise SceneError(problems)
        return self.electrodes


def differ_only_in(keys: Sequence[str], scene: Scene, other: Scene) -> bool:
    """Return whether two scenes are equal except for the numbers at some keys.

    Parameters
    ----------
    keys : sequence of str
        Dotted keys of the numbers that may differ.
    scene, other : Scene
        The scenes to compare.

    Returns
    -------
    bool
        False also if one of the scenes lacks one of the keys.
    """
    try:
        numbers = {key: get_number(scene, key) for key in keys}
        return other.with_(**numbers) == scene
    except (ValueError, AttributeError, LookupError, TypeError):  # no such number in a scene
        return False


def make_scenes_at_positions(scene: Scene, positions_mm: Array) -> list[Scene]:
    """Return copies of a scene with its probe moved to the given positions.

    Parameters
    ----------
    scene : Scene
        A scene with one probe.
    positions_mm : ndarray, shape (n, 2)
        Centroids of the probe in mm.

    Returns
    -------
    list of Scene, length n

    Raises
    ------
    SceneError
        If the scene does not have exactly one probe, or if the probe does not fit on the film.
    """
    with prefix_errors("set"):
        if scene.single_probe is None:
            reason = "must have exactly one probe to move; give one [probe], or probe.shape here"
            raise SceneError([f"scene: {reason}"])
    with prefix_errors("reach_mm"):
        scenes = []
        for x, y in positions_mm.tolist():
            scenes.append(scene.with_(**{"probe.x_mm": x, "probe.y_mm": y}))
        return scenes


def get_probe_position_mm(scene: Scene) -> Array:
    """Return the coordinates x and y of the scene's probe in mm."""
    return np.array([get_number(scene, key) for key in PROBE_POSITION_KEYS])
