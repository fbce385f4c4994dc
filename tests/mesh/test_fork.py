"""Processes that are forked while another thread meshes."""

from __future__ import annotations

import os
import threading
import time

import pytest

from pvdf_fem import Scene
from pvdf_fem.mesh.gmsh_mesh import mesh_scene
from pvdf_fem.mesh.size_field import Sizes

SCENE = Scene().with_(probe={})
SIZES = Sizes({}, film=2e-3, growth=0.5)


def meshed_in_a_fork(seconds: float = 20.0) -> int | None:
    """Number of elements that a forked process has; None if it does not end in time."""
    reader, writer = os.pipe()
    child = os.fork()
    if not child:
        os.write(writer, str(mesh_scene(SCENE, SIZES).nelements).encode())
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader) as result:
        timer = threading.Timer(seconds, os.kill, (child, 9))
        timer.start()
        number = result.read()
        timer.cancel()
    os.waitpid(child, 0)
    return int(number) if number else None


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the system does not fork")
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_a_forked_process_meshes_though_another_thread_meshed():
    expected, stopped = mesh_scene(SCENE, SIZES).nelements, threading.Event()

    def work() -> None:
        while not stopped.is_set():
            mesh_scene(SCENE, SIZES)

    thread = threading.Thread(target=work)
    thread.start()
    try:
        for _ in range(5):
            time.sleep(0.03)
            assert meshed_in_a_fork() == expected
    finally:
        stopped.set()
        thread.join()
