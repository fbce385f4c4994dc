"""``python -m pvdf_fem``, and what the command ``pvdf-fem`` runs."""

import os
import signal
import sys
from types import FrameType


def main() -> int:
    """Run the command; returns its exit code. Ctrl-C ends it quietly from the first import on."""
    before = signal.signal(signal.SIGINT, _end)
    from pvdf_fem.cli.main import main as run

    signal.signal(signal.SIGINT, before)
    return run()


def _end(*_: int | FrameType | None) -> None:
    # no exception, which an import that it interrupts may turn into another one
    os.write(2, b"pvdf-fem: interrupted\n")
    os._exit(130)


if __name__ == "__main__":
    sys.exit(main())
