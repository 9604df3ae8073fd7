from __future__ import annotations

import io
import re
from typing import Any

import pytest
from rich.console import Console

from torch_activegp.cli.progress import EpisodeProgress, StageProgress, show_time


class Clock:
    """A clock that a test winds."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (0.2, "0 s"),
        (59.4, "59 s"),
        (59.6, "1 min 0 s"),
        (3599.7, "1 h 0 min"),
        (5400, "1 h 30 min"),
        (7199, "2 h 0 min"),
    ],
)
def test_times_in_words(seconds: float, words: str) -> None:
    assert show_time(seconds) == words


def test_the_time_left_counts_only_what_this_run_did() -> None:
    clock = Clock()
    with EpisodeProgress(Console(file=io.StringIO()), "running", 10, clock=clock) as progress:
        for _ in range(4):
            progress.advance(restored=True)
        clock.now += 60  # processes start
        progress.advance()
        assert progress.seconds_left is None
        clock.now += 3
        progress.advance()
        assert progress.seconds_left == pytest.approx(12)
        clock.now += 1
        progress.advance()
        assert progress.seconds_left == pytest.approx(6)


def test_a_file_gets_a_line_now_and_then() -> None:
    clock, file = Clock(), io.StringIO()
    with EpisodeProgress(Console(file=file), "running", 100, interval=10, clock=clock) as progress:
        for _ in range(25):
            clock.now += 1
            progress.advance()
    assert file.getvalue().splitlines() == [
        "running: 10 of 100 episodes, about 1 min 30 s left",
        "running: 20 of 100 episodes, about 1 min 20 s left",
    ]


def test_a_terminal_gets_a_bar() -> None:
    clock, file = Clock(), io.StringIO()
    console = Console(file=file, force_terminal=True, color_system=None, width=100)
    with EpisodeProgress(console, "running", 4, clock=clock) as progress:
        for _ in range(2):
            clock.now += 3
            progress.advance()
    text = file.getvalue()
    assert "2/4 episodes, about 6 s left" in text


def test_stages_get_a_line_now_and_then_with_the_time_left() -> None:
    clock, file = Clock(), io.StringIO()
    with StageProgress(Console(file=file), "diagnosing", interval=10, clock=clock) as progress:
        progress.tell("noise floor")
        clock.now += 11
        progress.tell("screening [all]", 0.2)
        clock.now += 12
        progress.tell("screening [all]", 0.4)
        clock.now += 3
        progress.tell("naming", 0.1)  # a new count
        clock.now += 9
        progress.tell("naming", 0.1)
        clock.now += 10
        progress.tell("naming", None)
    assert file.getvalue().splitlines() == [
        "diagnosing: screening [all], 20%",
        "diagnosing: screening [all], 40%, about 36 s left",
        "diagnosing: naming, 10%",
        "diagnosing: naming",
    ]


def test_stages_get_a_bar_on_a_terminal() -> None:
    clock, file = Clock(), io.StringIO()
    console = Console(file=file, force_terminal=True, color_system=None, width=100)
    with StageProgress(console, "diagnosing", clock=clock) as progress:
        progress.tell("naming", 0.0)
        clock.now += 5
        progress.tell("naming", 0.5)
        progress._bar.refresh()
    assert "diagnosing: naming, about 5 s left" in file.getvalue()


def test_what_is_done_now_is_shown_and_other_things_than_episodes_are_counted() -> None:
    clock, file = Clock(), io.StringIO()
    with EpisodeProgress(Console(file=file), "diagnosing", 3, unit="machines", interval=10, clock=clock) as progress:
        progress.tell("arm: reading")
        clock.now += 11
        progress.tell("arm: [naming]")
        clock.now += 11
        progress.advance()
    assert file.getvalue().splitlines() == [
        "diagnosing: 0 of 3 machines; arm: [naming]",
        "diagnosing: 1 of 3 machines; arm: [naming]",
    ]
    terminal = io.StringIO()
    with EpisodeProgress(Console(file=terminal, force_terminal=True, width=120), "diagnosing", 3) as progress:
        progress.tell("arm: [naming]")
    assert "arm: [naming]" in terminal.getvalue()


@pytest.mark.parametrize("stage", ["naming", "testing what comes on top of very many effects, one after the other"])
@pytest.mark.parametrize("make", [StageProgress, lambda console, title: EpisodeProgress(console, title, 3)])
def test_after_ctrl_c_what_is_said_has_a_line_of_its_own(make: Any, stage: str) -> None:
    file, width = io.StringIO(), 60
    console = Console(file=file, force_terminal=True, color_system=None, width=width)
    with pytest.raises(KeyboardInterrupt), make(console, "at work") as progress:
        progress.tell(stage)
        raise KeyboardInterrupt
    console.print("Interrupted.")
    show_cursor = "\x1b[?25h"
    assert file.getvalue().endswith(f"\n{show_cursor}Interrupted.\n")  # no code moves up or wipes before it is said
    lines = re.sub(r"\x1b\[[?0-9;]*[A-Za-z]", "", file.getvalue()).replace("\r", "\n").splitlines()
    assert stage[:20] in lines[-2]
    assert max(map(len, lines)) <= width - len("^C^C")


def test_an_error_leaves_no_stage_behind() -> None:
    file = io.StringIO()
    console = Console(file=file, force_terminal=True, color_system=None, width=50)
    with pytest.raises(ValueError, match="bad"), StageProgress(console, "diagnosing"):
        raise ValueError("bad")
    assert file.getvalue().endswith("\x1b[1A\x1b[2K")
