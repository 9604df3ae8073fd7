"""The house: layer order, mirrored tests, short modules, no machine or registry names; and that the checks can fail."""

from __future__ import annotations

import ast
import subprocess
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = "torch_activegp"
LAYERS = (
    ("errors", "files", "keys"),
    ("data", "physics"),
    ("simulators",),
    ("means",),
    ("models",),
    ("acquisition", "envs"),
    ("planners", "collectors", "diagnosis"),
    ("loops",),
    ("experiments", "report", "testing"),
    ("cli",),
    ("__main__",),
)
DIAGNOSIS = (
    ("checkpoint", "result"),
    ("inputs",),
    ("noise",),
    ("simulation",),
    ("shooting",),
    ("preparation",),
    ("selection",),
    ("findings",),
    ("diagnose", "evaluate"),
)
MAX_LINES = 300
# Written in two halves, so that this file passes its own check.
FORBIDDEN = tuple(
    first + second
    for first, second in (
        ("/wo", "rk/"),
        ("/tm", "p/"),
        ("/opt/wh", "eels"),
        ("/opt/py", "pi"),
        ("py", "pi.org"),
        ("pythonhosted", ".org"),
        ("download.pytorch", ".org"),
        ("conda.anaconda", ".org"),
    )
)


def modules(root: Path) -> list[Path]:
    return sorted((root / PACKAGE).rglob("*.py"))


def imported_modules(path: Path, root: Path) -> Iterator[tuple[int, str]]:
    """Line and dotted name (inside the package, without its own name) of everything that a file imports from it."""
    package = path.relative_to(root).with_suffix("").parts[:-1]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            start = ".".join(package[: len(package) + 1 - node.level]) if node.level else ""
            module = ".".join(part for part in (start, node.module) if part)
            names = [f"{module}.{alias.name}" for alias in node.names]
        else:
            continue
        for name in names:
            if name == PACKAGE or name.startswith(PACKAGE + "."):
                yield node.lineno, name.removeprefix(PACKAGE).removeprefix(".")


def layer_faults(root: Path, inside: str = "", layers: tuple[tuple[str, ...], ...] = LAYERS) -> list[str]:
    """Imports that point to the right or across one layer, and packages that no layer names.

    Args:
        root: of the repository.
        inside: the dotted package that is looked at, inside the whole one.
        layers: of that package, an arrow from one to itself or to the left is fine.
    """
    rank = {name: position for position, layer in enumerate(layers) for name in layer}
    outer = tuple(inside.split(".")) if inside else ()
    faults = []
    for path in modules(root):
        parts = path.relative_to(root / PACKAGE).with_suffix("").parts
        if parts[: len(outer)] != outer:
            continue
        here = parts[len(outer)]
        if here == "__init__":  # the front door may show what lies in any layer
            continue
        if here not in rank:
            faults.append(f"{path.relative_to(root)}: `{here}` is in no layer")
            continue
        for line, name in imported_modules(path, root):
            names = tuple(name.split("."))
            if names[: len(outer)] != outer:
                continue
            there = ".".join(names[len(outer) : len(outer) + 1])
            if there != here and rank.get(there, len(layers)) >= rank[here]:
                faults.append(f"{path.relative_to(root)}:{line}: `{here}` may not import `{there}`")
    return faults


def mirror_faults(root: Path) -> list[str]:
    """Modules without a test file at the mirrored path."""
    faults = []
    for path in modules(root):
        module = path.relative_to(root / PACKAGE)
        mirror = root / "tests" / module.with_name(f"test_{module.name}")
        if module.stem not in ("__init__", "__main__") and not mirror.is_file():
            faults.append(f"{path.relative_to(root)}: write {mirror.relative_to(root)}")
    return faults


def length_faults(root: Path) -> list[str]:
    """Modules of more than MAX_LINES lines."""
    lengths = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in modules(root)}
    return [f"{path.relative_to(root)}: {lines} lines" for path, lines in lengths.items() if lines > MAX_LINES]


def place_faults(paths: Iterable[Path]) -> list[str]:
    """Text files that name a folder of one machine or a package registry."""
    faults = []
    for path in paths:
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError:  # a picture
            continue
        lines = enumerate(text.splitlines(), start=1)
        faults += [f"{path}:{number}: {word}" for number, line in lines for word in FORBIDDEN if word in line]
    return faults


def test_imports_point_only_to_the_left() -> None:
    assert layer_faults(ROOT) == []


def test_so_they_do_inside_the_diagnosis() -> None:
    assert layer_faults(ROOT, "diagnosis", DIAGNOSIS) == []


def test_every_module_has_its_mirrored_test_file() -> None:
    assert mirror_faults(ROOT) == []


def test_no_module_is_too_long() -> None:
    assert length_faults(ROOT) == []


def test_no_file_names_a_machine_or_a_registry() -> None:
    listing = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    if listing.returncode != 0:
        pytest.skip("not a git checkout: the list of the repository's files is not known")
    files = [path for path in map(ROOT.joinpath, listing.stdout.splitlines()) if path.is_file()]
    assert ROOT / "README.md" in files
    assert place_faults(files) == []


def _tree(root: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return root


@pytest.mark.parametrize(
    ("file", "line"),
    [
        ("data/a.py", "from torch_activegp.models.gp import DynamicsGP"),
        ("data/a.py", "import torch_activegp.simulators"),
        ("data/a.py", "from torch_activegp import physics"),
        ("envs/a.py", "from ..acquisition.score import Score"),
        ("planners/a.py", "def f():\n    from torch_activegp.loops import ActiveLearning"),
        ("errors.py", "from . import keys"),
        ("errors.py", "from .data import load_recordings"),
        ("models/a.py", "from torch_activegp import DynamicsGP"),
        ("models/a.py", "import torch_activegp"),
        ("utils/a.py", ""),
        ("helpers.py", ""),
    ],
)
def test_a_wrong_import_is_found(tmp_path: Path, file: str, line: str) -> None:
    assert len(layer_faults(_tree(tmp_path, {f"{PACKAGE}/{file}": line}))) == 1


@pytest.mark.parametrize(
    ("file", "line"),
    [
        ("models/a.py", "from torch_activegp.models.b import C"),
        ("models/a.py", "from .b import C"),
        ("models/a.py", "from ..errors import ShapeError"),
        ("cli/a.py", "from torch_activegp import errors, loops"),
        ("__init__.py", "from torch_activegp.cli import main"),
        ("data/a.py", "import torch"),
        ("data/a.py", "from torch_activegp_plugin import x"),
    ],
)
def test_a_right_import_passes(tmp_path: Path, file: str, line: str) -> None:
    assert layer_faults(_tree(tmp_path, {f"{PACKAGE}/{file}": line})) == []


@pytest.mark.parametrize(
    ("file", "line", "faults"),
    [
        ("noise/a.py", "from torch_activegp.diagnosis.shooting.fit import Fit", 1),
        ("noise/a.py", "from torch_activegp.diagnosis import diagnose", 1),
        ("noise/a.py", "from torch_activegp.diagnosis import shooting", 1),
        ("helpers.py", "", 1),
        ("shooting/a.py", "from torch_activegp.diagnosis.noise.floor import noise_floor", 0),
        ("shooting/a.py", "from torch_activegp.physics.effect import Effect", 0),
        ("shooting/a.py", "from torch_activegp.diagnosis.shooting.b import c", 0),
        ("__init__.py", "from torch_activegp.diagnosis.diagnose import diagnose", 0),
    ],
)
def test_a_wrong_import_inside_the_diagnosis_is_found(tmp_path: Path, file: str, line: str, faults: int) -> None:
    _tree(tmp_path, {f"{PACKAGE}/diagnosis/{file}": line, f"{PACKAGE}/data/a.py": "from torch_activegp.cli import b"})
    assert len(layer_faults(tmp_path, "diagnosis", DIAGNOSIS)) == faults


def test_a_missing_mirror_is_found(tmp_path: Path) -> None:
    _tree(tmp_path, {f"{PACKAGE}/data/{name}.py": "" for name in ("__init__", "a", "b")})
    _tree(tmp_path, {"tests/data/test_a.py": "", "tests/test_b.py": ""})
    assert mirror_faults(tmp_path) == [f"{PACKAGE}/data/b.py: write tests/data/test_b.py"]


@pytest.mark.parametrize(("lines", "faults"), [(MAX_LINES, 0), (MAX_LINES + 1, 1)])
def test_a_long_module_is_found(tmp_path: Path, lines: int, faults: int) -> None:
    assert len(length_faults(_tree(tmp_path, {f"{PACKAGE}/errors.py": "x = 1\n" * lines}))) == faults


@pytest.mark.parametrize("word", FORBIDDEN)
def test_a_place_name_is_found(tmp_path: Path, word: str) -> None:
    _tree(tmp_path, {"a.md": f"fine\nsee https://{word}x", "b.md": "fine"})
    (tmp_path / "c.png").write_bytes(b"\x89PNG\xff" + word.encode())
    assert [fault.split("a.md:")[1] for fault in place_faults(sorted(tmp_path.iterdir()))] == [f"2: {word}"]
