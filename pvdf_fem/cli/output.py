"""Output of subcommands: printed results, and the files of ``--plot`` and similar options."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pvdf_fem.files import FileError, require_writable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from pvdf_fem.summary import Result


def add_plot(parser: argparse.ArgumentParser, about: str) -> None:
    """Add the option ``--plot``; its help says that it draws `about`."""
    parser.add_argument(
        "--plot", metavar="FILE", type=Path, help=f"draw {about} (.png, .svg, .pdf, ...)"
    )


def save_plot(figure: Figure, options: argparse.Namespace) -> None:
    """Write a figure to the file of ``--plot``."""
    from pvdf_fem.view.figures import save_figure

    save_figure(figure, options.plot)


def find_output_errors(
    path: Path | None, extensions: Sequence[str], *inputs: Path | str | None
) -> list[str]:
    """Return error messages if an output file cannot be written.

    Parameters
    ----------
    path : Path or None
        The file, or None if the option is not used.
    extensions : sequence of str
        Extensions of the possible formats, such as ``.nc``.
    *inputs : Path or str or None
        Files that must not be overwritten. None is skipped.

    Returns
    -------
    list of str
        At most one message.
    """
    if path is None:
        return []
    if path.suffix.lower() not in extensions:
        return [f"{path}: has no extension of a known format; choose from {' '.join(extensions)}"]
    try:
        require_writable(path, *inputs)
    except FileError as error:
        return [str(error)]
    return []


def find_plot_errors(options: argparse.Namespace, *inputs: Path | str | None) -> list[str]:
    """Return error messages if the file of ``--plot`` cannot be written.

    Parameters
    ----------
    options : argparse.Namespace
        Options with `plot`, the path or None.
    *inputs : Path or str or None
        Files that must not be overwritten. None is skipped.

    Returns
    -------
    list of str
        At most one message.
    """
    if options.plot is None:
        return []
    from matplotlib.backend_bases import FigureCanvasBase

    extensions = [f".{extension}" for extension in FigureCanvasBase.get_supported_filetypes()]
    return find_output_errors(options.plot, extensions, *inputs)


def print_result(result: Result, as_json: bool) -> None:
    """Print a result on standard output, as text or as one JSON object.

    If a result did not converge, its text is not printed; instead its status, reason and warnings
    are printed on standard error.

    Parameters
    ----------
    result : Result
        A solution or another result with `to_json`.
    as_json : bool
        Whether to print JSON, which is done for all results.
    """
    values = result.to_json()
    if as_json:
        print(json.dumps(values, allow_nan=False))
    elif "reason" in values:
        print(f"not converged: {values['status']}: {values['reason']}", file=sys.stderr)
        for warning in values.get("warnings", ()):
            print(f"warning: {warning}", file=sys.stderr)
    else:
        print(result)
