"""Draw the equations of the guide, so that its pages need neither a network nor JavaScript."""

from __future__ import annotations

import html
import io
import re
from typing import Any

import matplotlib
from docutils import nodes
from matplotlib.font_manager import FontProperties
from matplotlib.mathtext import MathTextParser, math_to_image

POINTS = 12.0  #: Size of an equation within a sentence.
LARGE_POINTS = 15.0  #: Size of an equation on a line of its own.


def draw_equation(tex: str, size: float = POINTS) -> str:
    """Draw an equation in TeX as an SVG element whose baseline is that of the text around it."""
    font = FontProperties(size=size)
    drawing = io.StringIO()
    formula = "$" + " ".join(tex.split()) + "$"
    with matplotlib.rc_context({"svg.hashsalt": "pvdf_fem", "mathtext.fontset": "stix"}):
        math_to_image(formula, drawing, prop=font, format="svg")
        depth = MathTextParser("path").parse(formula, prop=font)[2]
    svg = re.search(r"<svg.*</svg>", drawing.getvalue(), re.S)
    assert svg is not None
    text = re.sub(r"<metadata>.*?</metadata>", "", svg[0], flags=re.S)
    # A page contains several equations, so their identifiers must differ.
    text = re.sub(r'(id="|xlink:href="#|url\(#)', rf"\g<1>m{abs(hash(tex)):x}-", text)
    text = text.replace("#000000", "currentColor").replace("#ffffff", "none")
    look = f'class="math" role="img" aria-label="{html.escape(tex)}" style="vertical-align:'
    return text.replace("<svg ", f'<svg {look} -{depth:.2f}pt" ', 1)


def visit_inline(writer: Any, node: nodes.math) -> None:
    """Write an equation within a sentence."""
    writer.body.append(draw_equation(node.astext()))
    raise nodes.SkipNode


def visit_block(writer: Any, node: nodes.math_block) -> None:
    """Write an equation on a line of its own."""
    svg = draw_equation(node.astext().replace(r"\frac", r"\dfrac"), LARGE_POINTS)
    writer.body.append(f'<div class="equation">{svg}</div>')
    raise nodes.SkipNode
