"""What the processes of :mod:`torch_activegp.experiments.spread` share; with real ones in ``test_spread.py``."""

from __future__ import annotations

import signal
import threading

import torch

from torch_activegp.experiments.workers import heard_by, interrupts_ignored, one_thread


def test_one_thread_is_put_back() -> None:
    before = torch.get_num_threads()
    with one_thread():
        assert torch.get_num_threads() == 1
    assert torch.get_num_threads() == before


def test_messages_are_heard_one_after_the_other_in_another_thread() -> None:
    heard: list[object] = []
    threads: set[int] = set()

    def tell(message: object) -> None:
        heard.append(message)
        threads.add(threading.get_ident())

    with heard_by(tell) as tell_parent:
        for message in ("a", ("b", 2)):
            tell_parent(message)
    assert heard == ["a", ("b", 2)]
    assert len(threads) == 1
    assert threads.isdisjoint({threading.get_ident()})


def test_interrupts_are_ignored_for_a_while_and_by_the_main_thread_alone() -> None:
    before = signal.getsignal(signal.SIGINT)
    with interrupts_ignored():
        assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN
    assert signal.getsignal(signal.SIGINT) is before
    seen = []

    def look() -> None:
        with interrupts_ignored():
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=look)
    thread.start()
    thread.join()
    assert seen == [before]
