"""Progress with the time that remains: a bar on a terminal, now and then a line elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

_ECHO = 4
"""Columns kept free behind a bar: a terminal writes ^C there, twice for who is in a hurry."""


class _Short:
    """Leaves the last columns of the terminal to what the keyboard echoes, so that drawing a bar anew wipes both."""

    def __init__(self, bar: RenderableType) -> None:
        self.bar = bar

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        yield from console.render(self.bar, options.update_width(max(options.max_width - _ECHO, 1)))


class _Bar(Progress):
    def get_renderable(self) -> RenderableType:
        return _Short(super().get_renderable())


class _Shown:
    """A bar that is there while the context is, on a terminal."""

    console: Console
    clock: Callable[[], float]
    _bar: _Bar
    _shown: float

    def __enter__(self) -> Self:
        """Show the bar."""
        self._shown = self.clock()
        if self.console.is_terminal:
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Let go of the bar; after Ctrl-C it stays, for what is said then needs a line that nothing else moves."""
        if self.console.is_terminal:
            if kind is not None and issubclass(kind, KeyboardInterrupt):
                self._bar.live.transient = False
            self._bar.stop()


class EpisodeProgress(_Shown):
    """Counts episodes; a context manager.

    Args:
        console: where to show it.
        title: what is being done.
        total: number of episodes, with those of an earlier run.
        unit: what is counted, if not episodes.
        interval: time between two lines where there is no terminal, s.
        clock: the present time, s.
    """

    def __init__(
        self,
        console: Console,
        title: str,
        total: int,
        *,
        unit: str = "episodes",
        interval: float = 10.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.console, self.title, self.total, self.unit = console, title, total, unit
        self._words = ""
        self.interval, self.clock = interval, clock
        self.done = self.restored = 0
        self._first: float | None = None
        self._shown = clock()
        columns = (
            TextColumn("{task.description}"),
            BarColumn(bar_width=20),
            MofNCompleteColumn(),
            TextColumn(f"{unit}{{task.fields[left]}},"),
            TimeElapsedColumn(),
            TextColumn("{task.fields[words]}", markup=False),
        )
        self._bar = _Bar(*columns, console=console, redirect_stdout=sys.stdout.isatty())
        self._bar_task = self._bar.add_task(title, total=total, left="", words="")

    @property
    def seconds_left(self) -> float | None:
        """What remains at the pace since the first new episode, s; None before the second.

        So neither the start of processes nor the episodes of an earlier run count.
        """
        further = self.done - self.restored - 1
        if self._first is None or further < 1:
            return None
        return (self.clock() - self._first) / further * (self.total - self.done)

    def advance(self, *, restored: bool = False) -> None:
        """Count one more episode; ``restored``: an earlier run did it."""
        self.done += 1
        self.restored += restored
        now = self.clock()
        if self._first is None and not restored:
            self._first = now
        self._bar.update(self._bar_task, completed=self.done, left=self._left())
        if not restored:
            self._print(now)

    def tell(self, words: str) -> None:
        """Show what is being done now."""
        self._words = words
        self._bar.update(self._bar_task, words=words)
        self._print(self.clock())

    def _print(self, now: float) -> None:
        if self.console.is_terminal or now - self._shown < self.interval:
            return
        self._shown = now
        line = f"{self.title}: {self.done} of {self.total} {self.unit}{self._left()}"
        words = f"; {self._words}" if self._words else ""
        self.console.print(line + words, highlight=False, markup=False, soft_wrap=True)

    def _left(self) -> str:
        return "" if self.seconds_left is None else f", about {show_time(self.seconds_left)} left"


class StageProgress(_Shown):
    """Shows which stage a long computation is in; a context manager.

    Args:
        console: where to show it.
        title: what is being done.
        interval: time between two lines where there is no terminal, s.
        clock: the present time, s.
    """

    def __init__(
        self, console: Console, title: str, *, interval: float = 10.0, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.console, self.title = console, title
        self.interval, self.clock = interval, clock
        self._mark: tuple[float, float] | None = None
        self._shown = clock()
        columns = (
            TextColumn("{task.description}{task.fields[left]}", markup=False),
            BarColumn(bar_width=20),
            TimeElapsedColumn(),
        )
        self._bar = _Bar(*columns, console=console, redirect_stdout=sys.stdout.isatty(), transient=True)
        self._bar_task = self._bar.add_task(title, total=None, left="")

    def tell(self, stage: str, done: float | None = None) -> None:
        """Show a stage.

        Args:
            stage: what is being done, in words.
            done: fraction done, 0 to 1; None where it is not known. Where it falls back, a new count has begun.
        """
        now = self.clock()
        left = self._left(now, done)
        words = f"{self.title}: {stage}"
        self._bar.update(self._bar_task, description=words, total=None if done is None else 1.0, left=left)
        if done is not None:
            self._bar.update(self._bar_task, completed=done)
        if not self.console.is_terminal and now - self._shown >= self.interval:
            self._shown = now
            share = "" if done is None else f", {done:.0%}"
            self.console.print(f"{words}{share}{left}", highlight=False, markup=False, soft_wrap=True)

    def _left(self, now: float, done: float | None) -> str:
        """What remains at the pace since the count began."""
        if done is None:
            return ""
        if self._mark is None or done < self._mark[1]:
            self._mark = (now, done)
        began, first = self._mark
        if done == first:
            return ""
        return f", about {show_time((now - began) / (done - first) * (1 - done))} left"


def show_time(seconds: float) -> str:
    """Minutes and seconds, or hours and minutes, in words.

    Example:
        >>> show_time(75.2), show_time(4000), show_time(8)
        ('1 min 15 s', '1 h 7 min', '8 s')
    """
    whole, minutes = round(seconds), round(seconds / 60)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{minutes // 60} h {minutes % 60} min"
