"""A count with the time left: a bar on a terminal, now and then a line elsewhere."""

from __future__ import annotations

import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn


class Counter:
    """Counts what is done; a context manager."""

    def __init__(self, console: Console, title: str, total: int, interval: float = 20.0) -> None:
        self.console, self.title, self.total, self.interval = console, title, total, interval
        self.done, self.start = 0, time.monotonic()
        self.shown = self.start
        columns = (TextColumn(title), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
        self.bar = Progress(*columns, console=console, disable=not console.is_terminal)
        self.task = self.bar.add_task(title, total=total)

    def __enter__(self) -> Counter:
        self.bar.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.bar.stop()

    def advance(self) -> None:
        """One more is done."""
        self.done += 1
        self.bar.advance(self.task)
        now = time.monotonic()
        if not self.console.is_terminal and (now - self.shown > self.interval or self.done == self.total):
            self.shown = now
            left = (now - self.start) / self.done * (self.total - self.done)
            self.console.print(f"{self.title}: {self.done} of {self.total}, about {left / 60:.1f} min left")
