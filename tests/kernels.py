"""Tests under other kernels of the BLAS and numbers of threads, before a release:
``python tests/kernels.py`` for all tests, ``python tests/kernels.py tests/validation`` for some.

Sums of another order may show an assertion that holds where it was written only. The kernels are
those that OpenBLAS takes for a processor; one that it refuses is told and left out.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
#: OpenBLAS has no others for x86; Zen is Haswell's.
KERNELS = "Haswell,SkylakeX,Sandybridge"
#: Prints the kernel that NumPy's OpenBLAS uses, empty for another BLAS.
USED = """
import ctypes, pathlib, numpy
folder = pathlib.Path(numpy.__file__).parents[1] / "numpy.libs"
for path in folder.glob("libscipy_openblas*"):
    name = ctypes.CDLL(str(path)).scipy_openblas_get_corename64_
    name.restype = ctypes.c_char_p
    print(name().decode())
"""


def run(kernel: str, threads: int, *command: str) -> str:
    """What a Python process prints with a kernel and a number of threads."""
    counts = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), str(threads))
    environment = {**os.environ, **counts, "OPENBLAS_CORETYPE": kernel}
    arguments = [sys.executable, *command]
    how = {"cwd": ROOT, "env": environment, "text": True, "stderr": subprocess.STDOUT}
    return subprocess.run(arguments, stdout=subprocess.PIPE, check=False, **how).stdout


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kernels", default=KERNELS, help="separated by commas")
    parser.add_argument("--threads", default="1,2", help="numbers of threads")
    options, asked = parser.parse_known_args()
    failed = False
    for kernel in options.kernels.split(","):
        if (used := run(kernel, 1, "-c", USED).strip()) != kernel:
            print(f"{kernel}: left out, NumPy uses {used or 'no OpenBLAS'}")
            continue
        for threads in map(int, options.threads.split(",")):
            printed = run(kernel, threads, "-m", "pytest", "-q", "-n", "auto", *asked).splitlines()
            failures = [line for line in printed if line.startswith(("FAILED", "ERROR"))]
            print(f"{kernel}, {threads} threads:", *failures, printed[-1], sep="\n", flush=True)
            failed |= bool(failures)
    return failed


if __name__ == "__main__":
    sys.exit(main())
