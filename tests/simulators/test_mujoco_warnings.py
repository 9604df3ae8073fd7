from __future__ import annotations

import mujoco
import pytest

from torch_activegp.simulators.mujoco_warnings import warnings_to

UNSTABLE = "<mujoco><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>"


def provoke() -> None:
    model = mujoco.MjModel.from_xml_string(UNSTABLE)
    data = mujoco.MjData(model)
    data.qvel[0] = 1e12
    mujoco.mj_step(model, data)


def test_the_handler_gets_the_warning_and_the_old_one_comes_back(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    outer: list[str] = []
    inner: list[str] = []
    mujoco.set_mju_user_warning(outer.append)
    try:
        with warnings_to(inner.append):
            provoke()
        provoke()
    finally:
        mujoco.set_mju_user_warning(None)
    assert ["QVEL" in message for message in inner] == [True]
    assert ["QVEL" in message for message in outer] == [True]
    assert not list(tmp_path.iterdir())


def test_overlapping_blocks_end_with_the_handler_from_before() -> None:
    first: list[str] = []
    one, two = warnings_to(first.append), warnings_to(print)
    one.__enter__()
    two.__enter__()
    one.__exit__(None, None, None)
    provoke()
    assert mujoco.get_mju_user_warning() is not None
    two.__exit__(None, None, None)
    assert mujoco.get_mju_user_warning() is None
    assert len(first) == 1


def test_an_error_inside_restores_the_handler() -> None:
    with pytest.raises(KeyError), warnings_to(print):
        raise KeyError
    assert mujoco.get_mju_user_warning() is None
