"""Makes a report by its name.

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
    "design": (),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the report; returns its exit code, or 2 if there is no report of that name."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    name = given.pop(0) if given and not given[0].startswith("-") else DEFAULT
    if name not in REPORTS:
        known = ", ".join(REPORTS)
        print(
            f"reports: error: {name[:60]!r} is not a report; give one of {known}", file=sys.stderr
        )
        return 2
    out = OUT if name == DEFAULT else OUT / name
    where = ("--kinds", str(kinds_file(name)), "--out", str(out))
    code = cli.main(["report", str(script_of(name)), *where, *REPORTS[name], *given])
    if name != DEFAULT and code != 2 and (OUT / PAGE).is_file():
        script(DEFAULT).refresh(OUT)
    return code


def script_of(name: str) -> Path:
    """The path of a report's script."""
    return HERE / name / "report.toml"


def kinds_file(name: str) -> Path:
    """The path of the file with a report's own kinds."""
    return HERE / name / "special.py"


def script(name: str) -> Report:
    """The report of a name."""
    return Report.load(script_of(name), load_kinds(kinds_file(name)))


if __name__ == "__main__":
    sys.exit(main())
