"""``python -m pvdf_fem``, and what the command ``pvdf-fem`` runs."""

import gc
import os
import signal
import sys
from types import FrameType


def main() -> int:
    """Run the command; returns its exit code. Ctrl-C ends it quietly from the first import on."""
    gc.set_threshold(50_000)  # imports make many objects and no garbage, so look for it less often
    before = signal.signal(signal.SIGINT, _end)
    from pvdf_fem.cli.main import main as run

    signal.signal(signal.SIGINT, before)
    code = run()
    gc.freeze()  # what is left ends with the process, without a last search for garbage in it
    return code


def _end(*_: int | FrameType | None) -> None:
    # no exception, which an import that it interrupts may turn into another one
    os.write(2, b"pvdf-fem: interrupted\n")
    os._exit(130)


if __name__ == "__main__":
    sys.exit(main())
