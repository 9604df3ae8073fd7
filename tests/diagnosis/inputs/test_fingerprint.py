from __future__ import annotations

import dataclasses
import importlib
from pathlib import Path

import numpy as np
import pytest

import torch_activegp
from torch_activegp.diagnosis.inputs.blackbox import BlackBox, accelerations
from torch_activegp.diagnosis.inputs.fingerprint import _OURS, _code_of, _word, fingerprint
from torch_activegp.diagnosis.inputs.machine import make_machine
from torch_activegp.diagnosis.inputs.source import read_source
from torch_activegp.diagnosis.simulation.places import effects_for
from torch_activegp.physics.drag import ViscousFriction


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
            "from torch_activegp.physics.drag import ViscousFriction\n"
            "class Law(ViscousFriction):\n    name = 'law'\n"
            f"    def force(self, q, v, c): return -{factor} * c[0] * v\n"
        )
        monkeypatch.syspath_prepend(tmp_path)
        source, machine, _ = parts()
        kind = importlib.import_module(module).Law
        return fingerprint(source, machine, effects_for(machine.model, machine.channels, machine.fit, [kind]))

    assert word(2) != word(3)
    assert word(2) == word(2)


def test_a_users_class_is_known_by_the_files_of_those_above_it_and_by_its_own_fields(tmp_path, monkeypatch) -> None:
    """A law may be inherited, and may have constants."""
    monkeypatch.syspath_prepend(tmp_path)

    def made(name: str, factor: int):
        (tmp_path / f"{name}_base.py").write_text(
            "from torch_activegp.physics.drag import ViscousFriction\n"
            f"FACTOR = {factor}\n"
            "class Base(ViscousFriction):\n    def force(self, q, v, c): return -FACTOR * c[0] * v\n"
        )
        (tmp_path / f"{name}.py").write_text(
            f"import dataclasses\nfrom {name}_base import Base\n"
            "@dataclasses.dataclass(frozen=True, eq=False)\n"
            "class Law(Base):\n    name = 'law'\n    power: float = 1.0\n"
        )
        importlib.invalidate_caches()
        return importlib.import_module(name).Law

    first, second = made("lawa", 2), made("lawb", 3)
    (tmp_path / "lawb.py").write_bytes((tmp_path / "lawa.py").read_bytes())
    common = {"target": "joint:hip", "parameters": (), "seeds": np.zeros((1, 0)), "dof": 0}
    names = {field.name for field in dataclasses.fields(first)}
    common = {name: value for name, value in common.items() if name in names}
    assert _word(first(**common)) == _word(first(**common))
    assert _word(first(**common)) != _word(second(**common))
    assert _word(first(**common)) != _word(first(**common, power=2.0))


def test_a_class_without_source_is_never_the_same_again() -> None:
    kind = type("Typed", (ViscousFriction,), {"name": "typed", "__module__": "nowhere"})
    names = {field.name for field in dataclasses.fields(kind)}
    values = {"target": "joint:hip", "parameters": (), "seeds": np.zeros((1, 0)), "dof": 0}
    effect = kind(**{name: value for name, value in values.items() if name in names})
    assert _word(effect) != _word(effect)


def test_the_package_is_known_by_its_code(tmp_path) -> None:
    """By all of it: laws and simulators too."""
    assert Path(torch_activegp.__file__).parent == _OURS
    words = []
    for content in ("a = 1", "a = 2"):
        folder = tmp_path / content[-1]
        (folder / "inner").mkdir(parents=True)
        (folder / "inner" / "a.py").write_text(content)
        words.append(_code_of(folder))
    assert words[0] != words[1]


def test_only_values_of_known_kinds_are_taken(tmp_path) -> None:
    assert _word({1, "b"}) == _word({"b", 1})
    values = [None, True, 1, 1.0, "1", tmp_path, {"a": 1}, {"a": 2}, {"a"}, set(), ["a"], {"b": 1}]
    assert len({_word(value) for value in values}) == len(values)
    with pytest.raises(TypeError, match="a known kind wanted, found a object"):
        _word({"a": [object()]})


def test_another_version_of_the_package_is_another(parts, monkeypatch) -> None:
    before = fingerprint(*parts(), 0)
    monkeypatch.setattr("torch_activegp.diagnosis.inputs.fingerprint.version", lambda name: "9.9.9")
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
