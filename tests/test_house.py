"""The promises of the README's commands and of the CI script, and the guard of torch's global state."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from torch_activegp.experiments.demo import MODEL, Secret, record

ROOT = Path(__file__).resolve().parents[1]
INSTALL = """python3 -m venv .venv \\
    && .venv/bin/pip install -q -c constraints.txt -e """


@pytest.mark.parametrize("name", ["main-command", "test-command"])
def test_each_readme_command_is_complete_by_itself(name: str) -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    (block,) = re.findall(rf"<!-- {name} -->\n```bash\n(.*?)```", readme, flags=re.DOTALL)
    assert block.startswith(INSTALL)


def test_the_ci_script_runs_exactly_the_marked_block(tmp_path: Path) -> None:
    script = tmp_path / "repository" / ".ci" / "run"
    script.parent.mkdir(parents=True)
    script.write_bytes((ROOT / ".ci" / "run").read_bytes())
    recordings = tmp_path / "shared" / "recordings"
    recordings.mkdir(parents=True)
    readme = script.parents[1] / "README.md"
    block = '<!-- test-command -->\n```bash\necho "$TORCH_ACTIVEGP_DATA" \\\n  && pwd\nfalse\necho unreached\n```\n'
    readme.write_text(f"```bash\necho no\n```\n{block}", encoding="utf-8")
    done = subprocess.run(["bash", str(script)], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.stdout.split() == [str(recordings), str(readme.parent)]
    assert done.returncode == 1
    readme.write_text("no marked block", encoding="utf-8")
    done = subprocess.run(["bash", str(script)], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "exactly one bash block" in done.stderr


def test_constraints_pin_every_dependency_of_the_project() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = [name for names in project["optional-dependencies"].values() for name in names]
    wanted = {re.split(r"[\[<>=]", name)[0] for name in project["dependencies"] + extras}
    pins = (ROOT / "constraints.txt").read_text(encoding="utf-8").split()
    assert all(re.fullmatch(r"[\w.-]+==[\w.]+", pin) for pin in pins)
    assert wanted <= {pin.split("==")[0] for pin in pins}


LEAKS = {
    "default dtype": "torch.set_default_dtype(torch.float64)",
    "grad mode": "torch.set_grad_enabled(False)",
    "number of threads": "torch.set_num_threads(torch.get_num_threads() + 1)",
    "deterministic algorithms": "torch.use_deterministic_algorithms(True)",
}


def test_a_leak_of_torch_state_fails_its_test(tmp_path: Path) -> None:
    (tmp_path / "conftest.py").write_bytes((ROOT / "tests" / "conftest.py").read_bytes())
    tests = [f"def test_{number}():\n    {leak}\n" for number, leak in enumerate(LEAKS.values())]
    (tmp_path / "test_leaks.py").write_text("import torch\n\n" + "".join(tests) + "def test_clean():\n    pass\n")
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--rootdir", str(tmp_path), str(tmp_path)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert f"{len(LEAKS) + 1} passed, {len(LEAKS)} errors" in done.stdout
    for name in LEAKS:
        assert f"AssertionError: global torch state leaked: {name}: " in done.stdout


def example(name: str) -> str:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    (block,) = re.findall(rf"<!-- {name} -->\n```python\n(.*?)```", readme, flags=re.DOTALL)
    return str(block)


def test_the_readmes_example_runs_twice(tmp_path: Path) -> None:
    long = example("learn-example")
    short = long.replace("num_episodes=10", "num_episodes=2")
    assert short != long
    for _ in range(2):
        done = subprocess.run([sys.executable, "-c", short], cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        assert "episode 2" in done.stdout


def test_the_readmes_diagnosis_runs(tmp_path: Path) -> None:
    secret, rng = Secret("linear_spring", value=0.05), np.random.default_rng(0)
    (tmp_path / "model.xml").write_text(MODEL)
    for name in ("run1", "run2", "test1"):
        record(secret, rng).to_csv(tmp_path / f"{name}.csv", index=False)
    command = [sys.executable, "-c", example("diagnose-example")]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("The simulator leaves out linear_spring at joint:pivot (0.050")
    assert {"diagnosis.json", "corrected.xml"} <= {path.name for path in (tmp_path / "out").iterdir()}


@pytest.mark.parametrize(
    "page", [*sorted(path.relative_to(ROOT) for path in ROOT.glob("[!.]*/*.md")), Path("README.md")]
)
def test_every_relative_link_leads_somewhere(page: Path) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    links = re.findall(r"\]\(([^)#]+)\)", text)
    missing = [link for link in links if "://" not in link and not ((ROOT / page).parent / link).exists()]
    assert missing == []
    assert not re.search(r"\b(TODO|TBD|FIXME)\b", text)
