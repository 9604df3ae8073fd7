from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import Result

import torch_activegp
from torch_activegp.cli import figures as figures_module

COMMAND = [sys.executable, "-c", "from torch_activegp.cli import main; main()"]
LICENSED = """
import multiprocessing
from machines import whole

def make():
    if multiprocessing.current_process().name != "MainProcess": raise OSError("one process has the licence")
    return whole()
"""
TINY = ("--steps", "2", "--horizon", "2", "--methods", "discrepancy,opax,sigma")


@pytest.fixture
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures take most of the time of a tiny run."""
    monkeypatch.setattr(figures_module, "draw_figures", lambda *args, **options: [])


def test_a_study_writes_all_that_it_promises(run: Callable[..., Result], folder: Path) -> None:
    result = run("figures", "pendulum", "--trials", "2", "--episodes", "2", "--jobs", "1", "--out", "out", *TINY)
    assert result.exit_code == 0
    stems = ("max_variance", "mse", "discrepancy", "figures")
    pictures = {f"{stem}.{kind}" for stem in stems for kind in ("png", "svg")}
    others = {"metrics.csv", "summary.json", "settings.json", "claims.md", "trials"}
    assert {path.name for path in (folder / "out").iterdir()} == pictures | others
    table = pd.read_csv(folder / "out" / "metrics.csv")
    keys = [(method, trial, k) for method in ("discrepancy", "opax", "sigma") for trial in (0, 1) for k in (1, 2)]
    assert list(table[["method", "trial", "episode"]].itertuples(index=False, name=None)) == keys
    summary = json.loads((folder / "out" / "summary.json").read_text())
    last = table[table["episode"] == 2].groupby("method")["mse"]
    for method in ("discrepancy", "opax", "sigma"):
        found = summary["final"][method]["mse"]
        assert found == {"mean": last.mean()[method], "min": last.min()[method], "max": last.max()[method]}
    claims = (folder / "out" / "claims.md").read_text()
    assert [claim["verdict"] for claim in summary["claims"]][1] == "not distinguishable yet"
    for claim in summary["claims"]:
        cells = [claim[name].replace("|", "\\|") for name in ("text", "seen", "verdict")]
        assert f"| {' | '.join(cells)} |" in claims
        assert claim["verdict"] + ": " + claim["text"] in result.stdout
    assert "simulator alone: MSE 0.149" in result.stdout
    assert "Sigma-greedy" in result.stdout


def test_a_study_can_grow(run: Callable[..., Result], folder: Path, no_pictures: None) -> None:
    small = ("figures", "pendulum", "--steps", "2", "--horizon", "2", "--methods")
    run(*small, "sigma", "--trials", "1", "--episodes", "1", "--jobs", "1", "--out", "grown")
    grow = ("opax,sigma", "--trials", "2", "--episodes", "2", "--resume")
    result = run(*small, *grow, "--jobs", "1", "--out", "grown")
    assert result.exit_code == 0, result.output
    run(*small, "opax,sigma", "--trials", "2", "--episodes", "2", "--jobs", "1", "--out", "whole")
    grown, whole = ((folder / name / "metrics.csv").read_bytes() for name in ("grown", "whole"))
    assert grown == whole
    for change, message in ((("--trials", "1"), "trials: 2 there, 1 now"), (("--seed", "1"), "seed: 0 there")):
        result = run(*small, *grow, "--out", "grown", *change)
        assert result.exit_code == 2
        assert message in result.output


def test_a_factory_that_fails_in_a_worker_is_one_message(run: Callable[..., Result], folder: Path) -> None:
    (folder / "licensed.py").write_text(LICENSED)
    result = run("figures", "licensed:make", "--trials", "1", "--episodes", "1", "--jobs", "2", "--out", "out", *TINY)
    assert result.exit_code == 2
    assert result.output.count("Error: `licensed:make` raised OSError: one process has the licence.") == 1
    assert "Traceback" not in result.output


def test_two_processes_end_at_ctrl_c_and_one_finishes_the_same_table(
    run: Callable[..., Result], folder: Path, no_pictures: None
) -> None:
    small = ("figures", "machines:whole", "--steps", "2", "--horizon", "2", "--methods", "discrepancy,sigma")
    length = ("--trials", "1", "--episodes", "20")
    words = (*small, *length, "--out", "cut")
    environment = {**os.environ, "PYTHONPATH": str(Path(torch_activegp.__file__).parents[1])}
    process = subprocess.Popen(
        [*COMMAND, *words, "--jobs", "2"],
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    while len(list(folder.glob("cut/trials/*.pt"))) < 2 and process.poll() is None:  # each did an episode or more
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGINT)  # what a terminal sends
    output, _ = process.communicate(timeout=20)
    assert process.returncode == 130, output
    assert "Interrupted. cut keeps every complete episode: run the same command with --resume" in output
    assert "Traceback" not in output
    assert not (folder / "cut" / "metrics.csv").exists()
    deadline = time.monotonic() + 5
    while _group_lives(process.pid):
        assert time.monotonic() < deadline
        time.sleep(0.01)
    assert run(*words, "--jobs", "1", "--resume").exit_code == 0
    run(*small, *length, "--out", "whole", "--jobs", "1")
    cut, whole = ((folder / name / "metrics.csv").read_bytes() for name in ("cut", "whole"))
    assert cut == whole


def _group_lives(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["pendulun"], "did you mean 'pendulum'"),
        (["pendulum", "--methods", "sigma,sgma"], "did you mean 'sigma'"),
        (["pendulum", "--methods", ","], "found none"),
        (["pendulum", "--methods", "sigma,sigma"], "Wanted each method once"),
        (["pendulum", "--trials", "0"], "--trials"),
        (["pendulum", "--jobs", "-2"], "--jobs"),
        (["pendulum", "--horizon", "0"], "--horizon"),
        (["machines:real"], "add --prior"),
        (["machines:nan", "--prior", "machines:wrong"], "`machines:nan` returned [nan, nan]"),
    ],
)
def test_bad_input_is_one_message_and_leaves_nothing_behind(
    run: Callable[..., Result], folder: Path, words: list[str], message: str
) -> None:
    before = set(folder.iterdir())
    result = run("figures", *words)
    assert result.exit_code == 2
    assert message in " ".join(result.output.split())
    assert {path for path in folder.iterdir() if path.name != "__pycache__"} == before
