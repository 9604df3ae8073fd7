from __future__ import annotations

import itertools

import pytest

from torch_activegp.diagnosis.selection.adequacy import is_crowded, most_left


@pytest.mark.parametrize(
    ("left", "most"),
    [
        ({"visible": False}, 0.15),
        ({}, 0.06),
        ({"names": 2}, 0.06),
        ({"names": 3}, 0.03),
        ({"names": 2, "visible": False}, 0.15),
        ({"names": 3, "visible": False}, 0.1),
        ({"names": 3, "misfit": 1.28}, 0.03),
        ({"names": 3, "misfit": 1.29}, 0.01),
        ({"names": 3, "misfit": 1.29, "visible": False}, 0.1),
        ({"names": 2, "misfit": 1.29}, 0.06),
        ({"misfit": 1.6}, 0.06),
        ({"misfit": 1.61}, 0.02),
        ({"misfit": 5.01}, 0.01),
        ({"misfit": 5.01, "visible": False}, 0.01),
        ({"misfit": 2.1, "whole": 0.12}, 0.0),
        ({"misfit": 2.1, "whole": 0.08}, 0.02),
        ({"misfit": 1.9, "whole": 0.12}, 0.02),
        ({"cut_short": True, "misfit": 1.02}, 0.06),
        ({"cut_short": True, "misfit": 1.03}, 0.03),
        ({"cut_short": True, "misfit": 1.03, "visible": False}, 0.03),
        ({"cut_short": True, "misfit": 1.39}, 0.03),
        ({"cut_short": True, "misfit": 1.41}, 0.002),
        ({"corrections": 4, "missing": 0.06}, 0.06),
        ({"corrections": 5, "missing": 0.06}, 0.015),
        ({"corrections": 5, "missing": 0.04}, 0.06),
        ({"corrections": 5, "missing": 0.06, "misfit": 6.0}, 0.01),
    ],
)
def test_less_may_be_left_the_more_there_is_to_doubt(left, most: float) -> None:
    assert most_left(**({"misfit": 1.0, "missing": 0.0, "names": 1} | left)) == most


def test_more_of_anything_that_is_doubtful_never_lets_more_be_left() -> None:
    steps = {
        "misfit": (1.0, 1.3, 1.7, 2.5, 6.0),
        "missing": (0.0, 0.1),
        "names": (1, 3, 5),
        "corrections": (0, 5),
        "visible": (False, True),
        "cut_short": (False, True),
        "whole": (0.0, 0.5),
    }
    for values in itertools.product(*steps.values()):
        here = dict(zip(steps, values, strict=True))
        for name, value in here.items():
            for more in steps[name][steps[name].index(value) :]:
                assert most_left(**here | {name: more}) <= most_left(**here)


@pytest.mark.parametrize(
    ("missing", "names", "share", "crowded"),
    [
        (0.2, 4, 0.05, True),
        (0.2, 4, 0.03, False),
        (0.2, 3, 0.05, False),
        (0.2, 5, 0.002, True),
        (0.2, 5, 0.0005, False),
        (0.05, 5, 0.05, False),
    ],
)
def test_as_many_names_as_are_tried_must_explain_nearly_all(missing, names, share, crowded) -> None:
    assert is_crowded(missing, names, share) is crowded
