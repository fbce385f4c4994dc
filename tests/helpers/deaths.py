"""Tasks that kill their process, in a module that other processes import quickly."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path


def die_once(task: tuple[Path, int]) -> int:
    """Ten times the task's number; kills its process at the first task of number 3."""
    marker, number = task
    if number == 3 and not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return 10 * number


def die(number: int) -> int:
    """Ten times a number; kills its process for number 3."""
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return 10 * number


def wait(folder: str) -> None:
    """Leave a file named like the process, then wait for ten minutes."""
    Path(folder, str(os.getpid())).touch()
    time.sleep(600.0)
