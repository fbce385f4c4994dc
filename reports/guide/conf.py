"""Configuration of Sphinx: the theme furo, and notebooks in MyST Markdown that are all executed."""

from __future__ import annotations

import inspect
import os
import sys
from pathlib import Path

from nbclient import NotebookClient
from sphinx.application import Sphinx

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))  # for reports.guide
# Cells call the command pvdf-fem, and use one thread each.
os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
os.environ["OMP_NUM_THREADS"] = "1"
os.environ["PYTHONWARNINGS"] = "ignore:IProgress not found"  # tqdm in notebooks
os.environ["PVDF_FEM_CHECKOUT"] = str(ROOT)  # "how good is it" reads results and closed forms

project = "pvdf_fem"
author = "The pvdf_fem authors"
project_copyright = author
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
default_role = "code"
exclude_patterns = ["README.md"]

html_theme = "furo"
html_title = "pvdf_fem"
html_static_path = ["static"]
html_css_files = ["guide.css"]
html_show_copyright = False
html_copy_source = False
html_math_renderer = "drawn"

myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_render_markdown_format = "myst"  # tables in outputs
nb_execution_in_temp = True  # an empty folder, as a reader has it
nb_execution_timeout = 180
nb_execution_show_tb = True
nb_merge_streams = True
# A command's output comes in pieces, which the line above would break into lines.
setattr(NotebookClient, "coalesce_streams", True)  # noqa: B010

autodoc_member_order = "bysource"
autodoc_typehints = "none"
napoleon_google_docstring = False


def adapt_docstring(app: Sphinx, what: str, *event: object) -> None:
    """Adapt docstrings to reStructuredText.

    Bars of absolute values are not substitutions, and a colon in the first line of an attribute
    does not follow a type. A method has its own docstring where a field of its name has one, too.
    """
    _, documented, _, lines = event
    assert isinstance(lines, list)
    if what == "method" and (own := inspect.getdoc(documented)):
        lines[:] = [*own.splitlines(), ""]
    lines[:] = [line.replace("|", r"\|") for line in lines]
    if what in ("attribute", "property"):
        lines[:0] = ["..", ""]  # a comment, since napoleon reads "type: description" first


def print_page_name(app: Sphinx, page: str, source: list[str]) -> None:
    """Print the name of a page before its cells are run."""
    print(f"guide: {page}", file=sys.stderr)


def setup(app: Sphinx) -> None:
    """Write the reference pages, which come from the code, before Sphinx reads its sources."""
    from reports.guide.mathematics import visit_block, visit_inline
    from reports.guide.references import write_references

    app.add_html_math_renderer("drawn", (visit_inline, None), (visit_block, None))
    app.connect("autodoc-process-docstring", adapt_docstring, priority=400)
    app.connect("source-read", print_page_name)
    app.connect("builder-inited", lambda _: write_references(Path(__file__).parent / "generated"))
