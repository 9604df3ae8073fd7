from __future__ import annotations

import pickle
import re
from functools import partial
from pathlib import Path

import pytest
import torch

from torch_activegp.cli.tasks import check_methods, load_task
from torch_activegp.errors import ConfigurationError, SimulationError
from torch_activegp.experiments import FITTED, PRINTED, TASKS


@pytest.mark.parametrize("name", TASKS)
def test_a_built_in_task_has_its_name(name: str) -> None:
    assert load_task(name).name == name
    assert load_task("pendulum").gp is PRINTED


def test_two_factories_make_a_task_whose_faults_are_named(folder: Path) -> None:
    task = load_task("machines:real", "machines:wrong")
    assert (task.name, task.gp) == ("machines:real", FITTED)
    state, action = torch.tensor([0.0, 1.0]), torch.tensor([1.0])
    assert task.truth(state, action)[1].item() == pytest.approx(1.1)
    assert task.prior(state, action)[1].item() == pytest.approx(1.05)
    task = load_task("machines:nan", "machines:nan")
    assert torch.isnan(task.prior(torch.ones(2), action)).all()
    with pytest.raises(SimulationError, match="`machines:nan` returned"):
        task.truth(torch.ones(2), action)


def test_a_factory_can_make_the_whole_task(folder: Path) -> None:
    assert load_task("machines:whole").name == "cart"


def test_a_task_can_be_made_in_another_process(folder: Path) -> None:
    make = pickle.loads(pickle.dumps(partial(load_task, "machines:real", "machines:wrong", {"x": (0.0, 0.5)})))
    assert make().truth.state_space.high.tolist() == [0.5, 1.0]


def test_bounds_reach_both_simulators(folder: Path) -> None:
    task = load_task("rod.xml", "weak_rod.xml", {"qvel": (-5.0, 6.0)})
    for simulator in (task.truth, task.prior):
        assert (simulator.state_space.low[1].item(), simulator.state_space.high[1].item()) == (-5.0, 6.0)
    assert load_task("pendulum", None, {"theta_dot": (-1.0, 1.0)}).prior.state_space.high[1].item() == 1.0


@pytest.mark.parametrize(
    ("system", "prior", "message"),
    [
        ("pendulun", None, "Unknown system 'pendulun': did you mean 'pendulum'? Choose of pendulum, "),
        ("xyz", None, "Unknown system 'xyz'. Choose of pendulum, "),
        ("pendulum", "rod.xml", "`pendulum` brings its own imperfect simulator; leave out --prior"),
        ("machines:whole", "rod.xml", "`machines:whole` brings its own"),
        ("machines:real", None, "`machines:real` needs an imperfect simulator as the prior: add --prior"),
        ("machines:number", "rod.xml", "Simulator or a Task from `machines:number`, found a int"),
        ("machines:real", "machines:number", "Simulator from `machines:number`, found a int"),
        ("machines:real", "machines:whole", "Simulator from `machines:whole`, found a Task"),
        ("machines:fails", None, "`machines:fails` raised KeyError: 'the key to the lab'"),
        ("machines:real", "machines:fails", "`machines:fails` raised KeyError"),
        ("machines:gone", None, "found no `gone` in module `machines`"),
        ("machine:real", None, "found no module `machine`"),
        ("gone.xml", None, "found no file `gone.xml`"),
        ("machines:real", "machines:renamed", "['x', 'v'] in `machines:real` and ['x', 'w'] in `machines:renamed`"),
        ("rod.xml", "weak_rod.xml", "found none for qvel.hip. .* add --bounds qvel.hip=LOW:HIGH with numbers"),
        ("machines:unbounded", "machines:unbounded", "--bounds state0=LOW:HIGH --bounds state1=LOW:HIGH"),
    ],
)
def test_what_cannot_be_a_task_says_what_to_do(folder: Path, system: str, prior: str | None, message: str) -> None:
    with pytest.raises(ConfigurationError, match=re.escape(message).replace(re.escape(".*"), ".*")):
        load_task(system, prior)


def test_methods_are_known_and_named_once() -> None:
    assert check_methods(["sigma", "opax"]) == ["sigma", "opax"]
    with pytest.raises(ConfigurationError, match="Unknown method 'sgma': did you mean 'sigma'"):
        check_methods(["opax", "sgma"])
    for names in ([], ["sigma", "sigma"]):
        with pytest.raises(ConfigurationError, match="Wanted each method once, of .*; found (none|sigma, sigma)"):
            check_methods(names)
