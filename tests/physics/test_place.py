from __future__ import annotations

from torch_activegp.physics.place import Place


def test_the_item_is_the_models_own_name() -> None:
    assert Place("joint:arm:left", 0).item == "arm:left"
    assert Place("world", -1).item == ""


def test_a_joint_turns_back_unless_said_otherwise() -> None:
    place = Place("joint:elbow", 0)
    assert place.turns_back and place.both_ways
