"""The entry point of the command ``pvdf-fem`` and of ``python -m pvdf_fem``."""

import gc
import os
import signal
import sys
from types import FrameType


def main() -> int:
    """Run the command, and return its exit code. Ctrl-C ends it quietly, even during imports."""
    # imports make many objects and no garbage, so that frequent searches for garbage are a waste
    gc.set_threshold(50_000)
    handler_before = signal.signal(signal.SIGINT, _exit_at_once)
    from pvdf_fem.cli.main import main as run

    signal.signal(signal.SIGINT, handler_before)
    code = run()
    gc.freeze()  # the process ends, so that no last search for garbage is needed
    return code


def _exit_at_once(*_: int | FrameType | None) -> None:
    """Exit after Ctrl-C during an import, which may convert an exception to another one."""
    os.write(2, b"pvdf-fem: interrupted\n")
    os._exit(130)


if __name__ == "__main__":
    sys.exit(main())
