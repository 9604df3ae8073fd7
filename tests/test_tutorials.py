"""The tutorials run from top to bottom, each is short, and its last cell asserts what the text claims."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
TUTORIALS = sorted((ROOT / "tutorials").glob("[0-9][0-9]_*.py"))


def test_the_tutorials_are_there() -> None:
    names = [path.stem for path in TUTORIALS]
    assert names[:2] == ["01_simulator_as_mean", "02_active_learning_loop"]


@pytest.mark.parametrize("path", TUTORIALS, ids=lambda path: path.stem)
def test_a_tutorial_is_short_and_ends_in_an_assertion(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 120
    assert ast.get_docstring(ast.parse(text))
    last_cell = ast.parse(text.split("\n# %%")[-1].partition("\n")[2])
    assert any(isinstance(node, ast.Assert) for node in ast.walk(last_cell))


@pytest.mark.parametrize("path", TUTORIALS, ids=lambda path: path.stem)
def test_a_tutorial_runs(path: Path, tmp_path: Path) -> None:
    environment = {**os.environ, "MPLBACKEND": "Agg"}
    command = [sys.executable, str(path)]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
