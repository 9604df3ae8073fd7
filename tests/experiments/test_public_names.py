from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from torch_activegp import experiments


@pytest.mark.parametrize("name", experiments.__all__)
def test_a_public_name_is_the_one_of_its_module(name: str) -> None:
    found = getattr(experiments, name)
    assert getattr(found, "__module__", None) in (
        None,
        "builtins",
        f"{experiments.__name__}.{experiments._MODULES[name]}",
    )
    assert vars(experiments)[name] is found


def test_type_checkers_and_programs_find_the_same_names_in_the_same_modules() -> None:
    tree = ast.parse(Path(experiments.__file__).read_text(encoding="utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If))
    checked = {
        alias.name: str(node.module).removeprefix(f"{experiments.__name__}.")
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert checked == experiments._MODULES
    assert sorted(checked) == sorted(experiments.__all__)


def test_every_public_name_is_listed() -> None:
    assert set(experiments.__all__) <= set(dir(experiments))


def test_an_unknown_name_is_an_error() -> None:
    with pytest.raises(AttributeError, match="'torch_activegp.experiments' has no attribute 'run_studies'"):
        experiments.run_studies()
    with pytest.raises(ImportError, match="cannot import name 'run_studies'"):
        from torch_activegp.experiments import run_studies

        run_studies()


def test_a_module_imports_no_other() -> None:
    program = """
import sys
import torch_activegp.experiments.output
print(*(name for name in sys.modules if name.startswith("torch_activegp.experiments.")))
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["torch_activegp.experiments.output"]
