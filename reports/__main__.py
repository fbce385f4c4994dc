"""Makes a report by its name.

    python -m reports [NAME] [ARGUMENT ...]

Without a name it makes the thesis report. The arguments go to the report's own command;
``python -m reports NAME --help`` lists them.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module

from reports.front.catalogue import DEFAULT, REPORTS


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the report; returns its exit code, or 2 if there is no report of that name."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    name = given.pop(0) if given and not given[0].startswith("-") else DEFAULT
    if name not in REPORTS:
        text = f"{name[:60]!r} is not a report; give one of {', '.join(REPORTS)}"
        print(f"reports: error: {text}", file=sys.stderr)
        return 2
    report = REPORTS[name]
    code: int = import_module(report.module).main([*report.arguments, *given])
    return code


if __name__ == "__main__":
    sys.exit(main())
