"""StatefulParts finds all that changes while a run runs, also where a state_dict leaves it out."""

from __future__ import annotations

from functools import partial
from types import ModuleType

import pytest
import torch
from torch import nn
from torchrl.envs import StepCounter, TransformedEnv

from torch_activegp.envs import SimulatorEnv
from torch_activegp.loops.parts import StatefulParts
from torch_activegp.simulators import Pendulum


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def draw(generator: torch.Generator) -> float:
    return torch.rand((), generator=generator).item()


def test_what_has_no_state_is_left_out() -> None:
    parts = StatefulParts({"number": 3, "nothing": None, "function": len, "layer": nn.Linear(1, 1)})
    assert list(parts.items) == ["layer"]


def test_a_generator_is_a_part_of_its_own() -> None:
    generator = seeded()
    parts = StatefulParts({"chance": generator})
    state = parts.state()
    wanted = draw(generator)
    assert draw(generator) != wanted
    parts.restore(state)
    assert draw(generator) == wanted


def test_the_arguments_of_a_partial_are_parts() -> None:
    first, second, layer = seeded(), seeded(1), nn.Linear(1, 1)
    parts = StatefulParts({"fit": partial(partial(print, first, 3), layer, generator=second)})
    assert set(parts.items.values()) == {first, second, layer}


def test_the_model_that_a_planner_uses_is_a_part_with_the_chance_in_its_score(small_run: ModuleType) -> None:
    loop = small_run.make_loop()
    parts = StatefulParts({"policy": loop.policy})
    env = loop.policy[0].env
    assert parts.items["policy.module.0.env"] is env
    chance = env.world_model.score.terms[2].generator
    state = parts.state()
    wanted = draw(chance), draw(env.generator), draw(loop.policy[0].noise.generator)
    parts.restore(state)
    assert (draw(chance), draw(env.generator), draw(loop.policy[0].noise.generator)) == wanted


def test_the_base_of_a_transformed_environment_is_a_part() -> None:
    env = SimulatorEnv(Pendulum())
    parts = StatefulParts({"env": TransformedEnv(env, StepCounter())})
    state = parts.state()
    wanted = env.reset()["state"]
    parts.restore(state)
    assert torch.equal(env.reset()["state"], wanted)


def test_an_object_under_two_names_is_kept_once() -> None:
    layer = nn.Linear(1, 1)
    assert list(StatefulParts({"a": layer, "b": layer}).items) == ["a"]


def test_a_state_is_a_copy() -> None:
    layer = nn.Linear(2, 2)
    parts = StatefulParts({"layer": layer})
    state, before = parts.state(), layer.weight.detach().clone()
    with torch.no_grad():
        layer.weight.add_(1.0)
    assert torch.equal(state["layer"]["weight"], before)
    parts.restore(state)
    assert torch.equal(layer.weight, before)


def test_tensors_that_two_parts_share_are_written_once(small_run: ModuleType) -> None:
    loop = small_run.make_loop()
    state = StatefulParts({"gp": loop.gp, "policy": loop.policy}).state()
    copy = state["policy.module.0.env"]["world_model.gp.covar_module.raw_lengthscale"]
    assert state["gp"]["covar_module.raw_lengthscale"].data_ptr() == copy.data_ptr()


def test_the_state_of_other_parts_is_refused() -> None:
    with pytest.raises(ValueError, match=r"wanted the states of \['a'\], found those of \['b'\]"):
        StatefulParts({"a": seeded()}).restore({"b": seeded().get_state()})
