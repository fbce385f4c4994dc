"""What is simulated: film, electrodes, probe, load and numerics, validated and frozen.

A scene comes from a TOML file or is built from the models of its parts. Keys carry the units in
which people give them (mm, µm, GPa, pC/N); properties without a unit in their name are SI, and
nothing else in the package converts lengths or moduli. Defaults are the thesis's values:
`Scene()` is the four-electrode biaxial sensor without a probe.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, TypeAlias, overload

from pydantic import (
    Field,
    SerializerFunctionWrapHandler,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_serializer,
    model_validator,
)
from pydantic_core import PydanticCustomError

from pvdf_fem.scene.change import change
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.mistakes import MOST_MISTAKES, mistakes
from pvdf_fem.scene.placement import misplacements
from pvdf_fem.scene.quantity import Finite, Section, Whole, refusal, within
from pvdf_fem.scene.readout import Readout
from pvdf_fem.scene.registry import LOAD_CLASSES, OBSERVABLE_ENTRIES
from pvdf_fem.scene.scene_file import SceneError, parse_toml, read_scene_text, write_toml
from pvdf_fem.scene.shapes import Electrode, Electrodes, Layout, Probe
from pvdf_fem.scene.stage import Stage

__all__ = [
    "Electrode",
    "Film",
    "Layout",
    "Load",
    "Numerics",
    "Probe",
    "Readout",
    "Scene",
    "SceneError",
    "Stage",
]


if TYPE_CHECKING:
    LoadKind: TypeAlias = str
    ObservableName: TypeAlias = str
else:
    LoadKind = Literal[tuple(LOAD_CLASSES)]
    ObservableName = Literal[tuple(OBSERVABLE_ENTRIES)]


class Load(Section):
    """The force of the probe on the film, along z.

    ``dead``: a uniform pressure on the reference area; ``follower``: a pressure normal to the
    deformed film; ``rigid``: a flat punch, sliding or stuck in the plane (`contact`, which no
    other kind has; sliding when not given).
    """

    force_N: Annotated[Finite, within(0.0, 1e6, "N")] = 1.0
    kind: LoadKind = "dead"
    contact: Literal["sliding", "stuck"] | None = Field(None, validate_default=True)

    @field_validator("contact")
    @classmethod
    def _belongs_to_rigid(cls, value: str | None, info: ValidationInfo) -> str | None:
        kind = info.data.get("kind")
        if kind == "rigid":
            return value or "sliding"
        if value is not None and kind is not None:
            raise refusal(
                f'is for kind = "rigid" only, not "{kind}"; remove it or change load.kind'
            )
        return value

    @property
    def force(self) -> float:
        """Force in N."""
        return self.force_N


class Numerics(Section):
    """The relative error wanted in every charge, which observable is called charge, and limits.

    `tolerance` is relative to each charge. Where its parts, d31 S11 and d32 S22, cancel to less
    than 5 % of them, it is relative to 5 % of them, and a warning names charge, parts and error.
    `max_unknowns` is the largest number of unknowns of a mesh. `max_seconds` is the work allowed
    for a solve in seconds of one core, counted by unknowns and iterations, so that a result does
    not depend on the machine's load. A limit that is None is the solver's, which grows where the
    tolerance is below 1e-3.
    """

    tolerance: Annotated[Finite, within(1e-8, 0.5, ends=False)] = 1e-3
    observable: ObservableName = "material"
    max_unknowns: Annotated[Whole, within(100, 10_000_000, "unknowns")] | None = None
    max_seconds: Annotated[Finite, within(0.1, 1e6, "s")] | None = None

    @model_serializer(mode="wrap")
    def _without_default_limits(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """The table without limits that are None, as scene files leave them out."""
        return {key: value for key, value in handler(self).items() if value is not None}


if TYPE_CHECKING:

    class _LoadOrReader:
        """`scene.load` is the scene's load, while `Scene.load(path)` reads a file."""

        @overload
        def __get__(self, scene: None, owner: type[Scene]) -> Callable[[Path | str], Scene]: ...
        @overload
        def __get__(self, scene: Scene, owner: type[Scene]) -> Load: ...
        def __get__(self, scene: Any, owner: Any) -> Any: ...


class Scene(Section):
    """One film with its electrodes, a probe or none, a load, and what reads and positions them.

    Built directly, a scene with mistakes raises pydantic's `ValidationError`; `load`, `parse` and
    `with_` raise `SceneError`, which lists all mistakes under the keys of the scene file. Both
    are `ValueError`.
    """

    film: Film = Film()
    electrodes: Electrodes = Layout()
    probe: Probe | None = None
    if TYPE_CHECKING:
        load: _LoadOrReader = _LoadOrReader()
    else:
        load: Load = Load()
    numerics: Numerics = Numerics()
    readout: Readout | None = None
    stage: Stage | None = None

    @model_validator(mode="after")
    def _shapes_have_their_places(self) -> Self:
        electrodes = self.electrodes
        complaints = misplacements(
            self.film.radius_mm,
            electrodes if isinstance(electrodes, Layout) else dict(enumerate(electrodes)),
            self.probe,
            self.load.kind,
            self.numerics.observable,
        )
        if self.readout is not None:
            names = [electrode.name for electrode in self.electrode_list]
            complaints = chain(complaints, self.readout.mistakes(names))
        if problems := list(islice(complaints, MOST_MISTAKES + 1)):
            context = {"text": "\n".join(problems), "problems": problems}
            raise PydanticCustomError("misplaced", "{text}", context)
        return self

    @property
    def electrode_list(self) -> tuple[Electrode, ...]:
        """The electrodes, those of a layout resolved."""
        electrodes = self.electrodes
        return electrodes.electrodes if isinstance(electrodes, Layout) else electrodes

    @classmethod
    def parse(cls, text: str, source: str = "<text>") -> Scene:
        """Scene from the text of a scene file; `source` names it in a `SceneError`."""
        return cls._from_tables(parse_toml(text, source), source)

    @classmethod
    def _read(cls, path: Path | str) -> Scene:
        """Scene from a scene file; raises `SceneError` for whatever keeps it from being one."""
        return cls.parse(read_scene_text(Path(path)), str(path))

    def with_(self, /, **changes: Any) -> Scene:
        """Another scene, with some values changed.

        Parameters
        ----------
        **changes
            Values by dotted key, ``{"load.force_N": 2.0, "electrodes.0.x_mm": 8}``, or whole
            sections, ``probe=None``. A new shape leaves the sizes of the old one behind, and a
            load that becomes ``dead`` or ``follower`` its contact.

        Raises
        ------
        SceneError
            Listing all mistakes, as for a file.
        """
        tables = self._tables()
        return self._from_tables(tables, "", change(tables, changes))

    def to_toml(self) -> str:
        """The scene as a scene file with every key; parsing it gives an equal scene."""
        return write_toml(self._tables())

    def _tables(self) -> dict[str, Any]:
        return self.model_dump(mode="json", exclude_none=True)

    @classmethod
    def _from_tables(
        cls, tables: dict[str, Any], source: str, problems: Sequence[str] = ()
    ) -> Scene:
        try:
            scene = cls.model_validate(tables)
        except ValidationError as error:
            raise SceneError([*problems, *mistakes(error, tables, cls)], source) from None
        if problems:
            raise SceneError(problems, source)
        return scene


# The class alone has this attribute: an instance's dictionary, which comes first, has its load.
setattr(Scene, "load", Scene._read)  # noqa: B010
