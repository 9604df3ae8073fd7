"""How much of a mismatch names may leave, so that they explain it."""

from __future__ import annotations

from torch_activegp.diagnosis.selection.prospects import MAX_EFFECTS

INADEQUATE = 0.15
"""A set that leaves more of the mismatch than this does not explain it."""
SEEN = 0.06
"""The same where what is left is large against the noise too. One or two right names leave up to 0.053, and a name that
stands for what is not on the list 0.065."""
MANY, SEEN_BEHIND_MANY = 3, 0.03
"""The same behind so many names: together they imitate much that is not on the list. Right ones left up to 0.01."""
UNSEEN_BEHIND_MANY = 0.1
"""The same where what is left may be noise. Right ones behind filtered noise left 0.06; three that stood for a friction
that grows with the load 0.12."""
SHOWS_BEHIND_MANY, LITTLE_BEHIND_MANY = 1.28, 0.01
"""And where that is so many times the noise. Three right names left 1.25 at most on 300 cases; a gain, a rotor, a load
and a damping that stood for a rotor and six tuned values 1.42 with 0.011, three others 1.32 with 0.022."""
CLEAR, SEEN_CLEARLY = 1.6, 0.02
"""The same where it is so many times the noise. Right names left 1.5 of it at most, and 2.3 under a filter that no
spectrum showed, with 0.011 of the mismatch; a spring and a friction that stood for creep 1.9 with 0.022."""
LOUD, SEEN_LOUD = 5.0, 0.01
"""The same where it is so many times the noise. A real drive's right names left 0.001; what left more were a stop where
nothing was missing, and a load of 40 times the machine for a motor that was wired the other way round."""
DOUBLE, MUCH = 2.0, 0.1
"""Where a set leaves more than so many times the noise, and so much of all that is above it, noise of any colour is no
excuse. A spring, a load and a hysteresis that stood for a motor whose constant falls with its excursion left 2.2 and
0.12, of which a force free in time saw 0.005; right names left 1.4 at most on 120 cases, or next to nothing."""
CORRECTIONS, SEEN_BEHIND_CORRECTIONS = 5, 0.015
"""And behind so many corrections of a tuning, whatever is left: right names left 0.011 at most on 20 cases, a centre of
mass that stood for a coupling of two joints 0.021."""
A_LITTLE = 0.05
"""Unless it is no more of the noise: a right encoder's offset beside eight corrections left 0.04 of coloured noise,
which was 0.05 of a mismatch of 0.7."""
CROWDED = 0.04
"""The same where as many names as are tried leave it."""
OVERCROWDED = 0.001
"""The same where there are more names: those of a nominal that was tuned badly leave next to nothing."""
SOME_NOISE = 0.1
"""And what they leave is so large a part of the noise: four right names behind filtered noise left 0.05 of it, 6 % of a
mismatch of 0.8."""
IN_VAIN, SEEN_IN_VAIN = 1.02, 0.03
"""The same where the search was cut short, and more of the noise is left: after so much of it, nothing on the list
leaves noise alone. A friction that grows with the load left 0.09 behind Stribeck friction and a spring, at 50 Hz; what
is not listed left 1.05 times the noise at least on 20 cases, and a striker's right friction 0.98, with 0.05."""
SHOWS_IN_VAIN, LITTLE_IN_VAIN = 1.4, 0.002
"""And where that is so many times the noise. On 21 cases no right names from such searches left more than 1.1 times it;
a load and a push that stood for Stribeck's friction 1.8, with 0.006, a late encoder beside a right friction 1.6."""


def most_left(
    misfit: float,
    missing: float,
    names: int,
    corrections: int = 0,
    visible: bool = True,
    cut_short: bool = False,
    whole: float = 0.0,
) -> float:
    """The part of a mismatch that a set may leave.

    Args:
        misfit: chi2 per degree of freedom that it leaves.
        missing: chi2 per degree of freedom beyond noise that a force free in time explains of it.
        names: of the set.
        corrections: of a tuning, in the set.
        visible: whether what is left is large against the noise.
        cut_short: whether the search was.
        whole: part of the nominal's chi2 beyond the noise that it leaves, whatever noise that may be.
    """
    bars = (
        (True, INADEQUATE),
        (visible, SEEN),
        (names >= MANY, SEEN_BEHIND_MANY if visible else UNSEEN_BEHIND_MANY),
        (visible and misfit > SHOWS_BEHIND_MANY and names >= MANY, LITTLE_BEHIND_MANY),
        (misfit > CLEAR, SEEN_CLEARLY),
        (misfit > LOUD, SEEN_LOUD),
        (cut_short and misfit > IN_VAIN, SEEN_IN_VAIN),
        (cut_short and misfit > SHOWS_IN_VAIN, LITTLE_IN_VAIN),
        (leaves_much(misfit, whole), 0.0),
        (corrections >= CORRECTIONS and missing > A_LITTLE, SEEN_BEHIND_CORRECTIONS),
    )
    return min(share for holds, share in bars if holds)


def leaves_much(misfit: float, whole: float) -> bool:
    """Whether a set leaves so much, and so much of the mismatch, that it is no noise of any colour.

    Args:
        misfit: chi2 per degree of freedom that it leaves.
        whole: part of the nominal's chi2 beyond the noise that it leaves.
    """
    return misfit > DOUBLE and whole > MUCH


def is_crowded(missing: float, names: int, share: float) -> bool:
    """Whether as many names as are tried, or more, leave more than right ones do; see :func:`most_left`.

    Args:
        missing: see there.
        names: see there.
        share: the part of the mismatch that they leave.
    """
    most = CROWDED if names == MAX_EFFECTS else OVERCROWDED
    return names >= MAX_EFFECTS and missing > SOME_NOISE and share > most
