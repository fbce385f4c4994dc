"""Makes a report by its name.

    python -m reports [NAME] [ARGUMENT ...]

Without a name it makes the thesis report, by ``pvdf-fem report``; the others have commands of their
own. ``python -m reports NAME --help`` lists the arguments.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from pvdf_fem.cli import main as cli

HERE = Path(__file__).parent
#: The report that is made when none is named.
DEFAULT = "thesis"
#: Reports with commands of their own, each a module here.
OTHERS = ("locate", "design", "extremes", "error_vs_time")


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the report; returns its exit code, or 2 if there is no report of that name."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    name = given.pop(0) if given and not given[0].startswith("-") else DEFAULT
    if name == DEFAULT:
        script, kinds = (str(HERE / DEFAULT / file) for file in ("report.toml", "special.py"))
        where = ("--kinds", kinds, "--out", str(HERE / "out"))
        return cli.main(["report", script, *where, *given])
    if name not in OTHERS:
        known = ", ".join((DEFAULT, *OTHERS))
        print(
            f"reports: error: {name[:60]!r} is not a report; give one of {known}", file=sys.stderr
        )
        return 2
    code: int = import_module(f"reports.{name}").main(given)
    return code


if __name__ == "__main__":
    sys.exit(main())
