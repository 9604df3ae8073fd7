from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pytest
import torch
from typer.testing import Result

from torch_activegp.experiments.learned_model import load_learned

SLIDE = """
<mujoco><option timestep="0.005" gravity="0 0 0"/><worldbody><body>
<joint name="slide" type="slide" axis="1 0 0" {loss}/><geom size=".1" mass="1"/></body></worldbody>
<actuator><motor name="push" joint="slide"/></actuator></mujoco>"""

Run = Callable[..., Result]


@pytest.fixture(autouse=True)
def files(folder: Path) -> None:
    """A slide without friction, and three runs of a real one: positions in mm under names of its own."""
    (folder / "slide.xml").write_text(SLIDE.format(loss=""))
    (folder / "map.toml").write_text('time = "t"\nqpos.slide = { column = "x", unit = "mm" }\nctrl.push = "u"\n')
    model = mujoco.MjModel.from_xml_string(SLIDE.format(loss="damping='1' frictionloss='0.5'"))
    for seed, name in enumerate(("a", "b", "c")):
        data, time = mujoco.MjData(model), np.arange(1200) * 0.005
        rate, phase = np.random.default_rng(seed).uniform(1.0, 9.0, (2, 4, 1))
        control = 1.5 * np.sin(rate * time + phase).sum(0)
        position = np.empty_like(time)
        for row, force in enumerate(control):
            position[row], data.ctrl[0] = data.qpos[0], force
            mujoco.mj_step(model, data)
        raw = pd.DataFrame({"t": time, "x": 1e3 * position, "u": control})
        raw.to_csv(folder / f"{name}_raw.csv", index=False)
        raw.assign(x=position).set_axis(["time", "qpos.slide", "ctrl.push"], axis=1).to_csv(
            folder / f"{name}.csv", index=False
        )


def test_it_learns_reports_and_writes(run: Run, folder: Path) -> None:
    result = run("learn", "slide.xml", "a.csv", "b.csv", "--holdout", "c.csv", "--max-points", "100", "--out", "out")
    assert result.exit_code == 0
    for words in ("Errors on c.csv", "windows of 1 s", "free run", "qvel.slide", "See out/forecast.png."):
        assert words in result.output
    assert "a.csv: Velocities are slopes of local cubics" in result.output
    found = {path.name for path in (folder / "out").iterdir()}
    assert found == {"settings.json", "summary.json", "predictions.csv", "model.pt", "forecast.png", "forecast.svg"}
    summary = json.loads((folder / "out" / "summary.json").read_text())
    fit = summary["fit"]["holdout"]
    assert all(fit[kind]["after"] < fit[kind]["before"] / 5 for kind in ("one_step", "window", "free_run"))
    table = pd.read_csv(folder / "out" / "predictions.csv")
    error = table["qpos.slide.simulator_and_gp"] - table["qpos.slide.measured"]
    assert (error**2).mean() ** 0.5 == pytest.approx(
        summary["errors"]["free_run"]["simulator_and_gp"]["rmse"]["qpos.slide"]
    )
    model = load_learned(folder / "out" / "model.pt")
    assert model.dt == summary["dt"]
    assert model(torch.zeros(1, 2).double(), torch.zeros(1, 1).double()).shape == (1, 2)


def test_a_column_map_and_several_holdouts(run: Run, folder: Path) -> None:
    words = ["--columns", "map.toml", "--dt", "0.03", "--max-points", "40", "--seed", "3"]
    result = run("learn", "slide.xml", "a_raw.csv", "--holdout", "b_raw.csv", "--holdout", "c_raw.csv", *words)
    assert result.exit_code == 0
    summary = json.loads((folder / "runs" / "learn-slide" / "summary.json").read_text())
    assert summary["held_out"] == ["b_raw.csv", "c_raw.csv"]
    assert (summary["dt"], summary["num_points"], summary["seed"]) == (0.03, 40, 3)


def test_the_same_command_gives_the_same_bytes(run: Run, folder: Path) -> None:
    for out in ("first", "second"):
        assert run("learn", "slide.xml", "a.csv", "--max-points", "40", "--out", out).exit_code == 0
    for name in ("predictions.csv", "forecast.svg"):
        assert (folder / "first" / name).read_bytes() == (folder / "second" / name).read_bytes()
    assert (
        "Held out: the last fifth of a.csv, rows 961 to 1200."
        in json.loads((folder / "first" / "summary.json").read_text())["notes"]
    )


def test_a_model_that_diverges_is_reported(run: Run, folder: Path) -> None:
    """A simulator that breaks down far out: its free run diverges, and the table says so."""
    (folder / "machines.py").write_text(
        "import torch\n"
        "from torch_activegp.simulators import ActionSpace, FunctionSimulator, StateSpace\n"
        "def step(state, action):\n"
        "    velocity = state[..., 1:] + 0.05 * action + 0.5\n"
        "    following = torch.cat([state[..., :1] + 0.05 * velocity, velocity], dim=-1)\n"
        "    return torch.where(following.abs() < 20.0, following, torch.nan)\n"
        "def make():\n"
        "    states = StateSpace(['qpos.slide', 'qvel.slide'], -9.0, 9.0)\n"
        "    return FunctionSimulator(step, states, ActionSpace(['ctrl.push'], -9.0, 9.0), dt=0.05)\n"
    )
    result = run("learn", "machines:make", "a.csv", "--holdout", "c.csv", "--max-points", "40", "--out", "out")
    assert result.exit_code == 0
    assert "diverged at" in result.output
    summary = json.loads((folder / "out" / "summary.json").read_text())
    assert summary["fit"]["holdout"]["free_run"]["before"] is None
    assert summary["fit"]["holdout"]["free_run"]["after"] < 1.0
    assert summary["dt"] == 0.05


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nowhere.xml", "a.csv"], "nowhere.xml"),
        (["slide.xml", "nowhere.csv"], "nowhere.csv: no such file"),
        (["slide.xml", "a.csv", "--holdout", "nowhere.csv"], "nowhere.csv: no such file"),
        (["slide.xml", "a.csv", "--columns", "nowhere.toml"], "nowhere.toml: no such file"),
        (["slide.xml", "a_raw.csv"], "a_raw.csv: unknown column `t`|a_raw.csv"),
        (["rod.xml", "a.csv"], "a.csv: `rod.xml` has no qpos.slide, ctrl.push; it has qpos.hip, qvel.hip, ctrl.m"),
        (["slide.xml", "a.csv", "--holdout", "a.csv"], "a.csv is both learned from and held out"),
        (["slide.xml", "emps:trian"], "EMPS has no split `trian`"),
        (["slide.xml", "nobody:train"], "unknown data set `nobody:train`"),
        (["slide.xml", "a.csv", "--dt", "0.0001"], "a step of at least 0.005 s"),
        (["slide.xml", "a.csv", "--dt", "-1"], "--dt: wanted a time step > 0 s, found -1"),
        (["slide.xml", "a.csv", "--dt", "3"], "a step of 3 s leaves"),
        (["slide.xml", "a.csv", "--out", "."], "The output folder . is not empty"),
        (["slide.xml", "a.csv", "--out", "slide.xml"], "slide.xml"),
        (["machines:real", "a.csv"], "Rename x, v, u"),
        (["slide.xml"], "RECORDING"),
        (["slide.xml", "a.csv", "--max-points", "5"], "max-points"),
    ],
)
def test_bad_input_gets_one_message_and_exit_code_2(run: Run, folder: Path, words: list[str], message: str) -> None:
    before = sorted(folder.rglob("*"))
    result = run("learn", *words)
    assert result.exit_code == 2
    assert any(part in result.output for part in message.split("|"))
    assert result.output.count("Error") <= 1
    assert [path for path in sorted(folder.rglob("*")) if "__pycache__" not in str(path)] == before


def test_no_network_and_no_local_data_is_said(run: Run, folder: Path, monkeypatch) -> None:
    monkeypatch.delenv("TORCH_ACTIVEGP_DATA", raising=False)

    def unplugged(*args: object, **options: object) -> str:
        raise OSError("no route to host")

    monkeypatch.setattr("torch_activegp.data.public.pooch.retrieve", unplugged)
    result = run("learn", "emps", "emps:train")
    assert result.exit_code == 2
    assert "TORCH_ACTIVEGP_DATA is not set, and the download failed: no route to host" in result.output


def test_help_teaches(run: Run) -> None:
    output = run("learn", "--help").output
    for words in ("torch-activegp learn emps emps:train --holdout emps:test", "--columns", "--max-points", "emps:test"):
        assert words in output
