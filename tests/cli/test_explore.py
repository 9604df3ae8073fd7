from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import Result

from torch_activegp.cli import explore as explore_module
from torch_activegp.errors import PlanningError
from torch_activegp.loops import ActiveLearning

TINY = ("--steps", "2", "--horizon", "2")


@pytest.fixture
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures take most of the time of a tiny run."""
    monkeypatch.setattr(explore_module, "draw_figures", lambda *args, **options: [])


def test_a_run_writes_all_that_it_promises(run: Callable[..., Result], folder: Path) -> None:
    result = run("explore", "pendulum", "--episodes", "2", *TINY)
    assert result.exit_code == 0
    out = folder / "runs" / "explore-pendulum"
    stems = ("max_variance", "mse", "discrepancy", "figures")
    pictures = {f"{stem}.{kind}" for stem in stems for kind in ("png", "svg")}
    others = {"metrics.csv", "summary.json", "settings.json", "directed-0.pt"}
    assert {path.name for path in out.iterdir()} == pictures | others
    table = pd.read_csv(out / "metrics.csv")
    assert table["num_points"].tolist() == [2, 4]
    summary = json.loads((out / "summary.json").read_text())
    assert summary["mse"] == table["mse"].iloc[-1]
    assert summary["num_points"] == 4
    assert summary["prior_mse"] == pytest.approx(0.1487, abs=1e-4)
    assert "as printed in the paper" in result.output
    lines = [line for line in result.stdout.splitlines() if line.startswith("episode")]
    assert len(lines) == 2
    for word in ("max variance", "discrepancy", "mse"):
        assert lines[0].count(word) == 1
    assert "4 transitions brought the mean squared error from 0.149 (simulator alone) to" in result.stdout


def test_a_run_can_be_continued_with_more_episodes(run: Callable[..., Result], folder: Path, no_pictures: None) -> None:
    run("explore", "pendulum", "--episodes", "3", "--out", "whole", *TINY)
    run("explore", "pendulum", "--episodes", "1", "--out", "parts", *TINY)
    result = run("explore", "pendulum", "--episodes", "3", "--out", "parts", "--resume", *TINY)
    assert "Resumed after episode 1" in result.output
    assert (folder / "parts" / "metrics.csv").read_bytes() == (folder / "whole" / "metrics.csv").read_bytes()
    result = run("explore", "pendulum", "--episodes", "3", "--out", "parts", "--resume", *TINY)
    assert result.exit_code == 0
    assert "episode 3:" not in result.output
    result = run("explore", "pendulum", "--episodes", "2", "--out", "parts", "--resume", *TINY)
    assert result.exit_code == 2
    assert "episodes: 3 there, 2 now" in result.output


def test_an_own_system_is_explored(run: Callable[..., Result], folder: Path, no_pictures: None) -> None:
    words = ("explore", "machines:real", "--prior", "machines:wrong", "--episodes", "3", "--out", "out")
    result = run(*words)
    assert result.exit_code == 0, result.output
    summary = json.loads((folder / "out" / "summary.json").read_text())
    assert summary["mse"] < 0.01 * summary["prior_mse"]
    model = ("explore", "rod.xml", "--prior", "weak_rod.xml", "--bounds", "qvel=-5:5", "--episodes", "1")
    assert run(*model, *TINY, "--out", "rod").exit_code == 0
    settings = json.loads((folder / "rod" / "settings.json").read_text())
    assert settings["bounds"] == {"qvel": [-5.0, 5.0]}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["pendulun"], "did you mean 'pendulum'"),
        (["pendulum", "--method", "sgma"], "did you mean 'sigma'"),
        (["pendulum", "--episodes", "0"], "--episodes"),
        (["pendulum", "--steps", "0"], "--steps"),
        (["pendulum", "--horizon", "-1"], "--horizon"),
        (["pendulum", "--seed", "-1"], "--seed"),
        (["pendulum", "--seed", "one"], "--seed"),
        (["pendulum", "--tempo", "3"], "--tempo"),
        (["pendulum", "--bounds", "theta=1"], "wanted NAME=LOW:HIGH"),
        (["pendulum", "--bounds", "tehta=1:2"], "there are theta, theta_dot, torque"),
        (["machines:nan", "--prior", "machines:wrong"], "`machines:nan` returned [nan, nan] from state {'x': 1.0"),
        (["machines:real", "--prior", "machines:nan"], "`machines:nan` returned [nan, nan] from state {'x': 1.0"),
        (["machines:odd", "--prior", "machines:wrong"], "`machines:odd` returned shape (8000, 1) for states (8000, 2)"),
        (["machines:real", "--prior", "machines:odd"], "`machines:odd` returned shape"),
        (["machines:fails"], "raised KeyError"),
        (["rod.xml", "--prior", "weak_rod.xml"], "add --bounds qvel.hip=LOW:HIGH"),
    ],
)
def test_bad_input_is_one_message_and_leaves_nothing_behind(
    run: Callable[..., Result], folder: Path, words: list[str], message: str
) -> None:
    before = set(folder.iterdir())
    result = run("explore", *words)
    assert result.exit_code == 2
    assert message in " ".join(result.output.split())
    assert "Traceback" not in result.output
    assert {path for path in folder.iterdir() if path.name != "__pycache__"} == before


def test_an_output_folder_is_never_overwritten(run: Callable[..., Result], folder: Path) -> None:
    (folder / "full").mkdir()
    (folder / "full" / "thesis.txt").write_text("dear to me")
    for words, message in (
        (["--out", "full"], "full is not empty"),
        (["--out", "full", "--resume"], "no run to resume"),
        (["--out", "rod.xml"], "found the file rod.xml"),
        (["--out", "rod.xml/below"], "is a file"),
    ):
        result = run("explore", "pendulum", *words)
        assert result.exit_code == 2
        assert message in result.output
    assert [path.name for path in (folder / "full").iterdir()] == ["thesis.txt"]


def test_a_run_is_only_resumed_with_its_own_settings(
    run: Callable[..., Result], folder: Path, no_pictures: None
) -> None:
    run("explore", "pendulum", "--episodes", "1", "--out", "out", *TINY)
    for words, message in (
        (["pendulum", "--seed", "1"], "seed: 0 there, 1 now"),
        (["pendulum-brake"], "system: 'pendulum' there, 'pendulum-brake' now"),
        (["pendulum", "--method", "sigma"], "method: 'directed' there, 'sigma' now"),
    ):
        result = run("explore", *words, "--episodes", "1", "--out", "out", "--resume", *TINY)
        assert result.exit_code == 2
        assert message in result.output
    (folder / "out" / "directed-0.pt").write_text("spoilt")
    result = run("explore", "pendulum", "--episodes", "1", "--out", "out", "--resume", *TINY)
    assert result.exit_code == 2
    assert "method directed, seed 0: out/directed-0.pt is not a readable checkpoint" in result.output


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (PlanningError("No candidate has a finite return."), 2, "pendulum (imperfect simulator: Pendulum), method"),
        (KeyboardInterrupt(), 130, "Interrupted. out keeps every complete episode"),
    ],
)
def test_what_happens_in_the_middle(
    run: Callable[..., Result],
    no_pictures: None,
    monkeypatch: pytest.MonkeyPatch,
    error: BaseException,
    code: int,
    message: str,
) -> None:
    whole = ActiveLearning._run_episode

    def fail_in_the_second(loop: ActiveLearning) -> object:
        if loop.records:
            raise error
        return whole(loop)

    words = ("explore", "pendulum", "--episodes", "2", "--out", "out", *TINY)
    with monkeypatch.context() as patched:
        patched.setattr(ActiveLearning, "_run_episode", fail_in_the_second)
        result = run(*words)
    assert result.exit_code == code
    assert message in result.output
    assert "Resumed after episode 1" in run(*words, "--resume").output
