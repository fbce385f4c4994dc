"""Tasks that kill their process, in a module that other processes import quickly."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path


def die(task: tuple[Path | None, int]) -> int:
    """Ten times the task's number. Number 3 kills its process, once where it can leave a marker."""
    marker, number = task
    if number == 3 and not (marker and marker.exists()):
        if marker:
            marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return 10 * number


def wait(folder: str) -> None:
    """Leave a file named like the process, then wait for ten minutes."""
    Path(folder, str(os.getpid())).touch()
    time.sleep(600.0)
