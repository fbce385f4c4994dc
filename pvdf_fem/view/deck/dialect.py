"""Where the input languages of CalculiX and Abaqus differ."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import ClassVar

from pvdf_fem.view.deck.section import EngineeringConstants
from pvdf_fem.view.files.inp import format_number


class Dialect(ABC):
    """The keywords of one of the programs."""

    #: Label of a pressure along the normal of a membrane element, in ``*DLOAD``.
    pressure_label: ClassVar[str]
    #: Quantities that ``*EL PRINT`` writes for the charges.
    element_output: ClassVar[str]
    #: Additional parameters of ``*EL PRINT``.
    print_parameters: ClassVar[str] = ""
    #: Name of the orientation of orthotropic sheets; empty if the global axes are the default.
    orientation: ClassVar[str] = ""

    @abstractmethod
    def format_orthotropic(self, constants: EngineeringConstants) -> Iterator[str]:
        """Yield the lines of an orthotropic sheet in plane stress.

        Parameters
        ----------
        constants : EngineeringConstants
            Constants of the sheet in SI units.

        Yields
        ------
        str
        """

    def format_orientation(self) -> Iterator[str]:
        """Yield the lines that define `orientation`; none by default."""
        yield from ()


class CalculixDialect(Dialect):
    """CalculiX, which expands membranes to solids with plane stress."""

    # with the label P the pressure has no effect in the first step (2.20)
    pressure_label = "P1"
    element_output = "S, E"

    def format_orthotropic(self, constants: EngineeringConstants) -> Iterator[str]:
        """Yield engineering constants; those across the thickness do not act on a membrane.

        Zero Poisson's ratios across the thickness let the sheet keep its thickness.
        """
        E3 = min(constants.E1, constants.E2)
        first = (constants.E1, constants.E2, E3, constants.nu12, 0.0, 0.0)
        shear = (constants.G12, constants.G12)
        yield "*ELASTIC, TYPE=ENGINEERING CONSTANTS"
        yield ", ".join(map(format_number, (*first, *shear)))
        yield f"{format_number(constants.G12)}, 0."


class AbaqusDialect(Dialect):
    """Abaqus, whose membranes have plane stress and axes that turn with the film."""

    pressure_label = "P"
    element_output = "S, LE"
    print_parameters = ", POSITION=CENTROIDAL"
    orientation = "film_axes"

    def format_orthotropic(self, constants: EngineeringConstants) -> Iterator[str]:
        """Yield the constants of a lamina."""
        first = (constants.E1, constants.E2, constants.nu12)
        shear = (constants.G12,) * 3
        yield "*ELASTIC, TYPE=LAMINA"
        yield ", ".join(map(format_number, (*first, *shear)))

    def format_orientation(self) -> Iterator[str]:
        """Yield an orientation along x and y, turned by 0 degrees about the normal."""
        yield f"*ORIENTATION, NAME={self.orientation}"
        yield "1., 0., 0., 0., 1., 0."
        yield "3, 0."


#: Dialects by the name of the program.
DIALECTS: dict[str, Dialect] = {"calculix": CalculixDialect(), "abaqus": AbaqusDialect()}
