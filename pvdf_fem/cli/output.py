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
    """Add the option ``--plot``, a path or None.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Parser of a subcommand.
    about : str
        What the figure shows, for the help.
    """
    parser.add_argument(
        "--plot", metavar="FILE", type=Path, help=f"draw {about} (.png, .svg, .pdf, ...)"
    )


def save_plot(figure: Figure, options: argparse.Namespace) -> None:
    """Write a figure to the file of ``--plot``, which must have been used."""
    from pvdf_fem.view.figures import save_figure

    save_figure(figure, options.plot)


def find_output_errors(
    path: Path | None, extensions: Sequence[str], *inputs: Path | str | None
) -> list[str]:
    """Return an error message if the extension of an output file is unknown or it is not writable.

    Parameters
    ----------
    path : Path or None
        The file to write, or None if the option is not used.
    extensions : sequence of str
        Extensions of the possible formats, such as ``.nc``.
    *inputs : Path or str or None
        Files that must not be overwritten. None is skipped.

    Returns
    -------
    list of str
        At most one message; none if the option is not used.
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
    """Return an error message if matplotlib cannot write the file of ``--plot``.

    Parameters
    ----------
    options : argparse.Namespace
        Options with `plot`, the path, or None if the option is not used.
    *inputs : Path or str or None
        Files that must not be overwritten. None is skipped.

    Returns
    -------
    list of str
        At most one message; none if the option is not used.
    """
    if options.plot is None:
        return []
    from matplotlib.backend_bases import FigureCanvasBase

    extensions = [f".{extension}" for extension in FigureCanvasBase.get_supported_filetypes()]
    return find_output_errors(options.plot, extensions, *inputs)


def print_result(result: Result, as_json: bool) -> None:
    """Print a result on standard output, as one JSON object or as text.

    If a result did not converge, its status, reason and warnings are printed on standard error
    instead of the text.

    Parameters
    ----------
    result : Result
        A solution or another result. The key ``reason`` of its JSON says that it did not converge.
    as_json : bool
        Whether to print JSON, also if the result did not converge.
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
