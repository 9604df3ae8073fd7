"""Fixtures for all tests, and the guard that no test changes torch for the next one."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

if "PYTEST_XDIST_WORKER" in os.environ:  # the workers share the cores: one thread each
    os.environ.setdefault("OMP_NUM_THREADS", "1")

import matplotlib
import pytest
import torch

matplotlib.use("Agg")


def _torch_state() -> dict[str, object]:
    return {
        "default dtype": torch.get_default_dtype(),
        "default device": torch.get_default_device(),
        "grad mode": torch.is_grad_enabled(),
        "inference mode": torch.is_inference_mode_enabled(),
        "anomaly detection": torch.is_anomaly_enabled(),
        "number of threads": torch.get_num_threads(),
        "deterministic algorithms": torch.are_deterministic_algorithms_enabled(),
    }


@pytest.fixture(autouse=True)
def torch_state_is_kept() -> Iterator[None]:
    """Fail a test that leaves a global setting of torch changed, and put the setting back."""
    before = _torch_state()
    yield
    after = _torch_state()
    leaks = [f"{name}: {before[name]} became {after[name]}" for name in before if before[name] != after[name]]
    if leaks:  # only then: setting the default device, even to the same one, slows every later operation
        _restore(before)
    assert not leaks, "global torch state leaked: " + "; ".join(leaks)


def _restore(state: dict[str, object]) -> None:
    torch.set_default_dtype(state["default dtype"])
    torch.set_default_device(state["default device"])
    torch.set_grad_enabled(state["grad mode"])
    torch.autograd.set_detect_anomaly(state["anomaly detection"])
    torch.set_num_threads(state["number of threads"])
    torch.use_deterministic_algorithms(state["deterministic algorithms"])


@pytest.fixture
def generator() -> torch.Generator:
    """The source of chance of a test: a generator with a fixed seed."""
    return torch.Generator().manual_seed(0)


@pytest.fixture(scope="session")
def recordings_dir() -> Path:
    """The folder with the public recordings, or a skip that says how to provide it."""
    folder = os.environ.get("TORCH_ACTIVEGP_DATA")
    if not folder:
        pytest.skip("set TORCH_ACTIVEGP_DATA to the folder with the public recordings (emps/DATA_EMPS.mat, ...)")
    if not Path(folder).is_dir():
        pytest.skip(f"TORCH_ACTIVEGP_DATA={folder} is not a folder")
    return Path(folder)
