"""The lock that lets only one thread of a process use gmsh."""

from __future__ import annotations

import os
import threading

# gmsh has a single state per process, and a worker of a cluster may have several threads.
GMSH_LOCK = threading.Lock()
# A fork waits until no thread meshes: the child must not inherit a lock that is never released.
if hasattr(os, "register_at_fork"):
    os.register_at_fork(
        before=GMSH_LOCK.acquire,
        after_in_parent=GMSH_LOCK.release,
        after_in_child=GMSH_LOCK.release,
    )
