from __future__ import annotations

import pytest
import torch

from torch_activegp.data.recording import Recording
from torch_activegp.data.transitions import to_transitions
from torch_activegp.errors import DataError

STATES = ["qpos.x", "qvel.x"]


def run(rows: int, offset: float = 0.0, **more: torch.Tensor) -> Recording:
    time = torch.arange(rows, dtype=torch.float64) * 0.1
    columns = {"time": time, "qpos.x": offset + time**2, "qvel.x": 2 * time, "ctrl.u": torch.cos(time)}
    return Recording.from_columns("a.csv", columns | {f"qfrc.{name}": value for name, value in more.items()})


def test_each_row_meets_the_next_of_its_own_run() -> None:
    first, second = run(5), run(4, offset=100.0)
    data = to_transitions([first, second], STATES, ["ctrl.u"], dt=0.1)
    assert data.batch_size == torch.Size([7])
    assert {data[key].dtype for key in ("state", "action", ("next", "state"))} == {torch.float64}
    assert data["run"].tolist() == [0] * 4 + [1] * 3
    assert torch.equal(data["time"], torch.cat([first.time[:-1], second.time[:-1]]))
    for row, (recording, k) in enumerate([(first, k) for k in range(4)] + [(second, k) for k in range(3)]):
        now = torch.stack([recording["qpos.x"][k], recording["qvel.x"][k]])
        then = torch.stack([recording["qpos.x"][k + 1], recording["qvel.x"][k + 1]])
        assert torch.equal(data["state"][row], now)
        assert torch.equal(data["next", "state"][row], then)
        assert data["action"][row].tolist() == [recording["ctrl.u"][k]]


def test_columns_come_in_the_models_order() -> None:
    data = to_transitions([run(5, x=torch.arange(5.0))], STATES[::-1], ["qfrc.x", "ctrl.u"])
    assert torch.equal(data["state"], to_transitions([run(5)], STATES, [])["state"].flip(-1))
    assert data["action"][:, 0].tolist() == [0, 1, 2, 3]


def test_a_force_that_was_not_recorded_is_zero_and_no_action_is_an_empty_one() -> None:
    data = to_transitions([run(5)], STATES, ["ctrl.u", "qfrc.x"])
    assert data["action"][:, 1].tolist() == [0] * 4
    assert to_transitions([run(5)], STATES, [])["action"].shape == (4, 0)


@pytest.mark.parametrize(
    ("states", "actions", "message"),
    [
        (
            ["qpos.y"],
            [],
            "a.csv: the model wants `qpos.y`, the recording holds time, qpos.x, qvel.x, ctrl.u. Record it",
        ),
        (["qvel.y"], [], "wants `qvel.y`, .* Estimate it with `estimate_velocities`"),
        (STATES, ["ctrl.w"], "wants `ctrl.w`"),
    ],
)
def test_a_missing_column_lists_what_is_there(states: list[str], actions: list[str], message: str) -> None:
    with pytest.raises(DataError, match=message):
        to_transitions([run(5)], states, actions)


def test_another_time_step_is_refused() -> None:
    with pytest.raises(
        DataError, match=r"a.csv: a step of 0.05 s wanted, found 0.1 s after 0 s. .*resample\(recording"
    ):
        to_transitions([run(5)], STATES, [], dt=0.05)
    time = torch.tensor([0.0, 0.1, 0.2, 0.35, 0.4])
    jittered = Recording.from_columns("b", {"time": time, "qpos.x": time})
    assert len(to_transitions([jittered], ["qpos.x"], [])) == 4
    with pytest.raises(DataError, match="b: a step of 0.1 s wanted, found 0.15 s after 0.2 s"):
        to_transitions([jittered], ["qpos.x"], [], dt=0.1)


def test_nothing_is_refused() -> None:
    with pytest.raises(DataError, match="no recording"):
        to_transitions([], STATES, [])
