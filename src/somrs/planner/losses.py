"""Why services are lost to a plan, in words: in a building with a hundred doors, most say the same."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from somrs.planner.model.problem import LostService

MOST_NAMED = 3
"""Of so many services that have the same reason, all are named."""


def resting_text(services: Iterable[LostService]) -> str:
    """After a statement that no device offers a service: why those that would do not. Empty if there are none."""
    reasons = [*dict.fromkeys(loss.reason for loss in services)]
    count = len(reasons) if len(reasons) <= MOST_NAMED else MOST_NAMED - 1
    further = [f"{len(reasons) - count} more would, too"] if len(reasons) > count else []
    return f" ({'; '.join([*reasons[:count], *further])})" if reasons else ""


def losses_text(services: Sequence[LostService]) -> str:
    """The lost services with their reasons. Those that say the same of themselves are named together."""
    losses_by_reason: dict[str, list[LostService]] = {}
    for loss in services:
        provider = re.escape(loss.service.partition(".")[0])
        losses_by_reason.setdefault(re.sub(rf"(?<!\w){provider}(?!\w)", "each", loss.reason), []).append(loss)
    texts: list[str] = []
    for common_reason, losses in losses_by_reason.items():
        count = len(losses) if len(losses) <= MOST_NAMED else MOST_NAMED - 1
        further = [f"{len(losses) - count} more"] if len(losses) > count else []
        named = " and ".join([*(loss.service for loss in losses[:count]), *further])
        texts.append(f"{named}: {common_reason if len(losses) > 1 else losses[0].reason}")
    return "; ".join(texts)
