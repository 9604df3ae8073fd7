from __future__ import annotations

from torch_activegp import keys

NAMES = {name: value for name, value in vars(keys).items() if name.isupper() and isinstance(value, str)}


def test_keys_are_distinct_so_that_no_module_overwrites_what_another_reads() -> None:
    assert len(set(NAMES.values())) == len(NAMES)


def test_the_table_explains_every_key() -> None:
    for name in NAMES:
        assert f"\n{name} " in keys.__doc__


def test_the_posterior_fills_keys_that_the_environment_does_not() -> None:
    assert set(keys.POSTERIOR_KEYS) == set(NAMES.values()) - {keys.STATE, keys.ACTION, keys.SCORE, keys.REWARD}
