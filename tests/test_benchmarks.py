"""The benchmarks run, and their competitors give equal answers; how fast they are is not asserted."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


def run_quick(name: str, out: Path) -> dict:
    command = [sys.executable, str(ROOT / "benchmarks" / f"{name}.py"), "--quick", "--out", str(out)]
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    environment = {**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    results = json.loads((out / f"{name}.json").read_text(encoding="utf-8"))
    assert results["quick"] is True
    assert results["machine"]["threads"] == 1
    assert str(ROOT) not in json.dumps(results)
    return results


@pytest.mark.slow
def test_every_planner_sees_the_same_returns(tmp_path: Path) -> None:
    for result in run_quick("plan", tmp_path)["results"]:
        assert set(result["difference"]) == {"gpytorch", "gpytorch, fast_pred_var", "CEMPlanner"}
        assert max(result["difference"].values()) < 1e-8
        assert all(seconds > 0 for seconds in result["seconds"].values())


@pytest.mark.slow
def test_every_way_to_add_a_point_predicts_the_same(tmp_path: Path) -> None:
    results = run_quick("update", tmp_path)
    assert len(results["difference"]) == 8
    assert max(results["difference"].values()) < 1e-8


@pytest.mark.slow
def test_memory_grows_with_the_square_of_the_points(tmp_path: Path) -> None:
    small, large = run_quick("scaling", tmp_path)["results"]
    ratio = (large["n"] / small["n"]) ** 2
    assert 8 * large["n"] ** 2 <= large["kept_bytes"] < 2.5 * 8 * large["n"] ** 2
    assert large["kept_bytes"] < 1.2 * ratio * small["kept_bytes"]
    assert (tmp_path / "scaling.png").stat().st_size > 10_000
    assert len((tmp_path / "scaling.csv").read_text(encoding="utf-8").splitlines()) == 3


@pytest.mark.slow
def test_fewer_points_leave_the_variance_and_every_elite(tmp_path: Path) -> None:
    for result in run_quick("fewer", tmp_path)["results"].values():
        assert result["near points: error of the squared norm"] < 1e-8
        assert result["few points first: candidates left after 50, mean"] >= 10
