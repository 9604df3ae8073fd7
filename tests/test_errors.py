from __future__ import annotations

import inspect
import pickle

import pytest

from torch_activegp import errors

CLASSES = [item for _, item in inspect.getmembers(errors, inspect.isclass) if item is not errors.ActiveGPError]


@pytest.mark.parametrize("error", CLASSES)
def test_every_error_is_ours_and_a_builtin_one(error: type[Exception]) -> None:
    assert issubclass(error, errors.ActiveGPError)
    assert issubclass(error, (ValueError, RuntimeError))
    assert error.__doc__


@pytest.mark.parametrize("error", CLASSES)
def test_an_error_survives_the_way_back_from_a_worker_process(error: type[Exception]) -> None:
    copy = pickle.loads(pickle.dumps(error("what was found")))
    assert type(copy) is error
    assert str(copy) == "what was found"
