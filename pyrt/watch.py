"""What happens between the passes of a render: progress is reported, and limits end it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt
from time import perf_counter
from typing import Any

from pyrt.passes import Tally

Progress = Callable[[dict[str, Any]], Any]


@dataclass
class Watch:
    """Over one render. Numbers are of samples, times are in seconds.

    Attributes:
        report: gets an event after each pass; returning False stops the render.
        tally: what the passes add up to.
        before: that a resumed render had.
        total: that the picture will have at most.
        at_least: that it gets whatever the time limit.
        start: on perf_counter's clock.
        time_limit: from the start on; infinite for none.
        target: of the picture's squared error; 0 for none.
        error: squared, as far as it is known.
    """

    report: Progress
    tally: Tally
    before: int
    total: int
    at_least: int
    start: float
    time_limit: float
    target: float
    error: float | None = None
    stopped: bool = False

    def after_pass(self) -> bool:
        """Whether the render goes on."""
        samples, elapsed = self.tally.samples, perf_counter() - self.start
        done = elapsed / self.time_limit
        if self.error:
            done = max(done, self.target / self.error)  # the squared error falls as samples grow
        if self.error is not None or not self.target:  # until then, nobody knows how many samples there will be
            done = max(done, (self.before + samples) / self.total)
        event = {"stage": "render", "done": min(done, 1.0), "samples": samples, "rays": self.tally.rays}
        event["noise"] = None if self.error is None else sqrt(self.error)
        late = elapsed >= self.time_limit and samples >= self.at_least
        self.stopped |= self.report(event) is False or late
        return not self.stopped

    def note_error(self, squared: float) -> None:
        """Takes the estimate of the picture's squared relative error."""
        self.error = squared

    def going(self) -> bool:
        """Whether nothing has stopped the render."""
        return not self.stopped
