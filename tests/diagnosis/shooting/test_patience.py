import pytest

from torch_activegp.diagnosis.shooting.patience import Patience

POOR, KEPT, LARGE = (0.5, 80.0, 12500.0), (0.5, 0.6, 12500.0), (50.0, 8000.0, 12500.0)


@pytest.mark.parametrize(
    ("steps", "ends"),
    [
        ([POOR] * 2, False),
        ([POOR] * 3, True),
        ([POOR, POOR, KEPT, POOR, POOR], False),  # what keeps its promise is no poor step, however small
        ([POOR, POOR, LARGE, POOR, POOR], False),  # nor what takes away a part of chi2
        ([POOR, POOR, KEPT, POOR, POOR, POOR], True),
    ],
)
def test_three_poor_steps_in_a_row_are_too_many(steps, ends) -> None:
    patience = Patience()
    for step in steps:
        patience.take(*step)
    assert patience.ends is ends
