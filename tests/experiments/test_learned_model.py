from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
import torch

from torch_activegp.errors import CheckpointError, ConfigurationError
from torch_activegp.experiments.learn import Learned, learn
from torch_activegp.experiments.learned_model import load_learned, save_learned
from torch_activegp.loops.checkpoint import save_checkpoint
from torch_activegp.means import SimulatorMean


@pytest.fixture
def outcome(slide: str, slide_run) -> Learned:
    return learn(slide, [slide_run()], max_points=30, dt=0.03)


def inputs() -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    return tuple(torch.randn(7, size, generator=generator, dtype=torch.float64) for size in (2, 1))


def test_it_comes_back_with_every_bit(outcome: Learned, tmp_path: Path) -> None:
    outcome.learned.trust[1] = 0.5
    save_learned(tmp_path / "model.pt", outcome)
    loaded = load_learned(tmp_path / "model.pt")
    assert torch.equal(loaded(*inputs()), outcome.learned(*inputs()))
    assert loaded.dt == outcome.learned.dt == 0.03
    assert loaded.state_space.names == outcome.simulator.state_space.names
    assert loaded.trust.tolist()[1] == 0.5
    assert SimulatorMean(loaded).predict(torch.cat(inputs(), dim=-1)).shape == (7, 2)


def test_a_model_that_moved_is_named_by_the_caller(outcome: Learned, slide: str, tmp_path: Path) -> None:
    save_learned(tmp_path / "model.pt", outcome)
    moved = Path(slide).rename(tmp_path / "moved.xml")
    with pytest.raises(ConfigurationError, match="slide.xml"):
        load_learned(tmp_path / "model.pt")
    loaded = load_learned(tmp_path / "model.pt", str(moved))
    assert torch.equal(loaded(*inputs()), outcome.learned(*inputs()))


def test_a_model_that_changed_is_refused(outcome: Learned, slide: str, tmp_path: Path) -> None:
    save_learned(tmp_path / "model.pt", outcome)
    Path(slide).write_text(Path(slide).read_text().replace('mass="1"', 'mass="2"'))
    with pytest.raises(CheckpointError, match="predicts something else than when it was learned with"):
        load_learned(tmp_path / "model.pt")
    with pytest.raises(CheckpointError, match="has 4 states and 1 actions, not those that were learned with"):
        two = Path(slide).read_text().replace("<joint", "<joint name='other' type='hinge'/><joint")
        Path(slide).write_text(two)
        load_learned(tmp_path / "model.pt")


def test_names_that_are_no_files_stay_as_they_are(outcome: Learned, tmp_path: Path) -> None:
    save_learned(tmp_path / "model.pt", dataclasses.replace(outcome, model="emps"))
    with pytest.raises(CheckpointError, match="`emps` predicts something else"):
        load_learned(tmp_path / "model.pt")


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="found none"):
        load_learned(tmp_path / "model.pt")
    save_checkpoint(tmp_path / "loop.pt", {"kind": "loop"}, {})
    with pytest.raises(CheckpointError, match="kind"):
        load_learned(tmp_path / "loop.pt")
