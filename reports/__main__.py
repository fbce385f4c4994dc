"""Make a report by its name.

    python -m reports [NAME] [ARGUMENT ...]

Without a name it makes the thesis report, whose page begins with the verdicts of the others.
Reports are scripts, ``NAME/report.toml`` with kinds of figures in ``NAME/special.py``, and are made
by ``pvdf-fem report``. ``python -m reports NAME --help`` lists the arguments.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from pvdf_fem.cli import main as cli
from pvdf_fem.report.registry import load_kinds
from pvdf_fem.report.report import PAGE, Report

HERE = Path(__file__).parent
OUT = HERE / "out"
#: The report that is made when none is named.
DEFAULT = "thesis"
#: Reports and the arguments that each has by default; timings need a quiet machine.
REPORTS: dict[str, tuple[str, ...]] = {
    DEFAULT: (),
    "accuracy": ("--processes", "1"),
    "stability": (),
    "locating": (),
    "tracking": ("--processes", "1"),
    "design": (),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the report; returns its exit code, or 2 if there is no report of that name."""
    options = list(sys.argv[1:] if arguments is None else arguments)
    name = DEFAULT
    if options and not options[0].startswith("-"):
        name = options.pop(0)
    if name not in REPORTS:
        names = ", ".join(REPORTS)
        problem = f"{name[:60]!r} is not a report; give one of {names}"
        print(f"reports: error: {problem}", file=sys.stderr)
        return 2
    out = OUT if name == DEFAULT else OUT / name
    command = ["report", str(get_script_path(name)), "--kinds", str(get_kinds_path(name))]
    command += ["--out", str(out), *REPORTS[name], *options]
    code = cli.main(command)
    if name != DEFAULT and code != 2 and (OUT / PAGE).is_file():
        load_report(DEFAULT).refresh(OUT)
    return code


def get_script_path(name: str) -> Path:
    """Return the path of a report's script."""
    return HERE / name / "report.toml"


def get_kinds_path(name: str) -> Path:
    """Return the path of the file with a report's own kinds."""
    return HERE / name / "special.py"


def load_report(name: str) -> Report:
    """Read the report of a name."""
    return Report.load(get_script_path(name), load_kinds(get_kinds_path(name)))


if __name__ == "__main__":
    sys.exit(main())
