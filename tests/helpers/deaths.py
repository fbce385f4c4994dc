"""Tasks that kill their process; other processes import this module, so it is light."""

from __future__ import annotations

import os
import signal
from pathlib import Path


def die_once(task: tuple[Path, int]) -> int:
    """Kills its process when it is the first to ask for its number."""
    marker, number = task
    if number == 3 and not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return 10 * number


def die(number: int) -> int:
    """Kills its process for one number."""
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return 10 * number
