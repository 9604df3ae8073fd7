from __future__ import annotations

import dataclasses
import importlib

import numpy as np
import pytest

from torch_activegp.diagnosis.blackbox import BlackBox, accelerations
from torch_activegp.diagnosis.fingerprint import fingerprint
from torch_activegp.diagnosis.machine import make_machine
from torch_activegp.diagnosis.places import effects_for
from torch_activegp.diagnosis.source import read_source


@pytest.fixture(scope="module")
def parts(bench, record):
    """Everything that a diagnosis depends on, made anew."""

    def make(xml: str = bench.xml, **changes: object) -> list[object]:
        source = read_source(xml)
        machine = make_machine(source.model, [record("viscous", 0, **changes)], [record("viscous", 9, "kept")])
        return [source, machine, effects_for(machine.model, machine.channels, machine.fit)]

    return make


def test_the_same_input_made_twice_is_the_same(parts) -> None:
    assert fingerprint(*parts(), 0) == fingerprint(*parts(), 0)
    assert len(fingerprint(*parts(), 0)) == 64


def test_whatever_differs_is_another(parts, bench, record) -> None:
    position = record("viscous", 0)["qpos.hip"].numpy()
    source, machine, effects = parts()
    fewer = [effect for effect in effects if effect.name != "hysteresis"]
    first = effects[0]
    seeded = dataclasses.replace(first, seeds=np.nextafter(first.seeds, 9.0))
    words = [
        fingerprint(*parts(), 0),
        fingerprint(*parts(), 1),
        fingerprint(*parts(), "0"),
        fingerprint(*parts(), 0, 0),
        fingerprint(*parts(bench.xml.replace('mass="1"', 'mass="1.0001"')), 0),
        fingerprint(*parts(bench.xml.replace('model="pendulum"', 'model="other"')), 0),
        fingerprint(*parts(qpos__hip=np.nextafter(position, 9.0)), 0),
        fingerprint(*parts(name="another"), 0),
        fingerprint(source, dataclasses.replace(machine, notes=("set aside",)), effects, 0),
        fingerprint(source, dataclasses.replace(machine, holdout=()), effects, 0),
        fingerprint(source, machine, fewer, 0),
        fingerprint(source, machine, [seeded, *effects[1:]], 0),
    ]
    assert len(set(words)) == len(words)


def test_a_users_class_is_known_by_its_source(parts, tmp_path, monkeypatch) -> None:
    """Its law is not in its values."""

    def word(factor: int) -> str:
        module = f"law_{factor}"
        (tmp_path / f"{module}.py").write_text(
            "from torch_activegp.physics.friction import ViscousFriction\n"
            "class Law(ViscousFriction):\n    name = 'law'\n"
            f"    def force(self, q, v, c): return -{factor} * c[0] * v\n"
        )
        monkeypatch.syspath_prepend(tmp_path)
        source, machine, _ = parts()
        kind = importlib.import_module(module).Law
        return fingerprint(source, machine, effects_for(machine.model, machine.channels, machine.fit, [kind]))

    assert word(2) != word(3)
    assert word(2) == word(2)


def test_another_version_of_the_package_is_another(parts, monkeypatch) -> None:
    before = fingerprint(*parts(), 0)
    monkeypatch.setattr("torch_activegp.diagnosis.fingerprint.version", lambda name: "9.9.9")
    assert fingerprint(*parts(), 0) != before


def test_a_black_box_is_known_by_its_answers(black) -> None:
    def word(weight: float) -> str:
        simulator = black.simulator()
        if weight:
            step = simulator.step
            simulator.step = lambda state, action: step(state, (1.0 + weight) * action)
        source = read_source(simulator)
        assert isinstance(source.box, BlackBox)
        machine = make_machine(source.model, [black.record("none", 0)], [black.record("none", 1)], source.box)
        return fingerprint(source, machine, accelerations(effects_for(machine.model, machine.channels, machine.fit)))

    assert word(0.0) == word(0.0)
    assert word(0.0) != word(1e-3)
