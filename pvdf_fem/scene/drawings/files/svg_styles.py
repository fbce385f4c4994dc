"""Lengths, style sheets and visibility of SVG elements."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import NamedTuple
from xml.etree.ElementTree import Element

from pvdf_fem.scene.drawings.content import DrawingError
from pvdf_fem.scene.drawings.units import UNITS_MM

_LENGTH = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([A-Za-z]*|%)\s*")
#: Units of lengths in SVG, in CSS pixels.
PIXELS = {
    "": 1.0,
    "px": 1.0,
    "Q": UNITS_MM["mm"] / 4.0 / UNITS_MM["px"],
    **{name: UNITS_MM[name] / UNITS_MM["px"] for name in ("mm", "cm", "in", "pt", "pc")},
}


class Length(NamedTuple):
    """A length as SVG writes it: a number with a unit, or a percentage."""

    number: float
    unit: str  #: A key of `PIXELS`, or ``%``.


def parse_length(text: str, place: str) -> Length:
    """Parse a length; raise `DrawingError`, which names the place, for anything else.

    Parameters
    ----------
    text : str
        Such as ``12.5mm`` or ``50%``.
    place : str
        Element and attribute for the message.

    Returns
    -------
    Length
    """
    match = _LENGTH.fullmatch(text)
    if match is None or (match[2] not in PIXELS and match[2] != "%"):
        units = ", ".join(filter(None, PIXELS))
        reason = f'{place} is "{text[:40]}", which is no length in {units}'
        raise DrawingError(f"{reason} or %; write it in one of these units")
    return Length(float(match[1]), match[2])


def resolve_length(text: str, reference: float | None, place: str) -> float:
    """Convert a length to the units of its coordinate system.

    Parameters
    ----------
    text : str
        The length.
    reference : float or None
        The length that is 100 %; None if it is not known.
    place : str
        Element and attribute for messages.

    Returns
    -------
    float
    """
    length = parse_length(text, place)
    if length.unit != "%":
        return length.number * PIXELS[length.unit]
    if reference is None:
        reason = f"{place} = {text} is a share of a size that the drawing does not have"
        raise DrawingError(f"{reason}; give the drawing a viewBox")
    return 0.01 * length.number * reference


def get_tag(element: Element) -> str:
    """Return the name of an element without its namespace.

    Parameters
    ----------
    element : Element
        An element or a comment.

    Returns
    -------
    str
        Such as ``circle``; empty for a comment.
    """
    return element.tag.rpartition("}")[-1] if isinstance(element.tag, str) else ""


class _Rule(NamedTuple):
    """Declarations for the elements that a simple selector matches."""

    selector: str
    declarations: Mapping[str, str]


class StyleSheet:
    """The rules of a drawing's ``<style>`` elements with simple selectors: tag, .class and #id.

    Parameters
    ----------
    elements : iterable of Element
        All elements of the drawing.
    """

    def __init__(self, elements: Iterable[Element]) -> None:
        self.rules: list[_Rule] = []
        for element in elements:
            if get_tag(element) == "style":
                self._add_rules("".join(element.itertext()))
        # more specific selectors come later and win
        self.rules.sort(key=lambda rule: (rule.selector.count("#"), rule.selector.count(".")))

    def _add_rules(self, text: str) -> None:
        """Add the rules of one style sheet."""
        without_comments = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
        for selectors, body in re.findall(r"([^{}]+)\{([^{}]*)\}", without_comments):
            declarations = _parse_declarations(body)
            for selector in selectors.split(","):
                self.rules.append(_Rule(selector.strip(), declarations))

    def get_property(self, element: Element, name: str) -> str:
        """Return a property of an element, by its style, the rules or an attribute.

        Parameters
        ----------
        element : Element
            The element.
        name : str
            Name of the property, such as ``display``.

        Returns
        -------
        str
            Empty if the property is not set.
        """
        value = element.get(name, "")
        for rule in self.rules:
            if name in rule.declarations and _is_match(rule.selector, element):
                value = rule.declarations[name]
        own = _parse_declarations(element.get("style", ""))
        return own.get(name, value).replace("!important", "").strip()


def _parse_declarations(text: str) -> dict[str, str]:
    """Parse ``name: value; name: value``."""
    declarations = {}
    for part in text.split(";"):
        name, colon, value = part.partition(":")
        if colon:
            declarations[name.strip().lower()] = value.strip()
    return declarations


def _is_match(selector: str, element: Element) -> bool:
    """Return whether a simple selector matches an element; selectors with blanks never do."""
    match = re.fullmatch(r"(\*|[\w-]+)?((?:[.#][\w-]+)*)", selector)
    if not selector or match is None:
        return False
    if match[1] and match[1] not in ("*", get_tag(element)):
        return False
    classes = element.get("class", "").split()
    for mark, name in re.findall(r"([.#])([\w-]+)", match[2]):
        if mark == "." and name not in classes:
            return False
        if mark == "#" and name != element.get("id"):
            return False
    return True
