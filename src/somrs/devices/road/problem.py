"""What people are told of a robot that does not work: at once what it says, and after a while that it is not there."""

from __future__ import annotations

import asyncio
from collections.abc import Callable


class Problem:
    """That of one robot, after its name, such as `cannot drive: its stop button is pressed`. `observer` gets it when it has changed; None:
    there is none. `patience`: seconds after which an absence is a problem."""

    def __init__(self, observer: Callable[[str | None], None], patience: float) -> None:
        self._observer, self._patience = observer, patience
        self._fault: str | None = None
        self._absence: str | None = None
        self._told_problem: str | None = None
        self._is_due = False
        self._timer: asyncio.TimerHandle | None = None

    def renew(self, fault: str | None, absence: str | None) -> None:
        """`fault`: what the robot says that is wrong with it. `absence`: why it cannot be reached, or takes no part in traffic."""
        self._fault, self._absence = fault, absence
        if absence is None:
            self._is_due = False
            if self._timer is not None:
                self._timer.cancel()
                self._timer = None
        elif self._timer is None:
            self._timer = asyncio.get_running_loop().call_later(self._patience, self._become_due)
        self._tell_change()

    def tell_anew(self) -> None:
        """Somebody else is told from now on, who knows of no problem yet."""
        self._told_problem = None

    def _become_due(self) -> None:
        self._is_due = True
        self._tell_change()

    def _tell_change(self) -> None:
        problem = (self._absence if self._is_due else None) or self._fault
        if problem != self._told_problem:
            self._told_problem = problem
            self._observer(problem)
