"""The equations of motion compiled, where there is a C compiler; else None, and numpy does it (four times slower)."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path


@cache
def compiled() -> ctypes.CDLL | None:
    """The library, built once a process; UNSEEN_NUMPY=1 does without."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None or os.environ.get("UNSEEN_NUMPY"):
        return None
    library = Path(tempfile.mkdtemp(prefix="unseen_")) / "kernel.so"
    source = Path(__file__).with_name("kernel.c")
    done = subprocess.run([compiler, "-O2", "-shared", "-fPIC", str(source), "-o", str(library), "-lm"], check=False)
    if done.returncode:
        return None
    found = ctypes.CDLL(str(library))
    shutil.rmtree(library.parent)
    return found
