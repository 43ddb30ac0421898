"""The first signal asks for a stop, the second one leaves at once."""

from __future__ import annotations

import os
import signal

import pytest

from pyrt.signals import stop_requests


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda number: number.name)
def test_the_second_signal_leaves_at_once(number):
    before = signal.getsignal(number)
    with stop_requests() as stopped:
        assert not stopped()
        os.kill(os.getpid(), number)
        assert stopped()
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), number)
    assert signal.getsignal(number) is before


def test_without_it_the_first_one_leaves():
    with pytest.raises(KeyboardInterrupt):
        os.kill(os.getpid(), signal.SIGINT)
