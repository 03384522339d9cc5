"""A run that takes seconds, and an observer of campaigns."""

from __future__ import annotations

from collections.abc import Callable

from ngspring.campaign.run import Event
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem

TINY = SpringProblem((ControlPoint(-10, -2),), name="tiny", elements=8, l_i=10.0)


class Watch:
    """Keeps the events of a campaign, and may act on one."""

    def __init__(self, act: Callable[[Event], None] = lambda event: None) -> None:
        self.events: list[tuple[str, str]] = []
        self.act = act

    def __call__(self, event: Event) -> None:
        self.events.append((event.run.name, event.kind))
        self.act(event)

    def first(self, name: str, kind: str) -> int:
        return self.events.index((name, kind))
