"""The topics of the API's news."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Any

from somrs.api.fleet import Devices
from somrs.api.map_news import MapNews
from somrs.api.people import People
from somrs.api.questions import OpenQuestions
from somrs.api.system import SystemView
from somrs.api.task_feed import TaskChanged, TasksChanged
from somrs.api.traffic import Traffic
from somrs.client.refusals import ErrorReport
from somrs.limits import Limits
from somrs.protocol.messages.directory import ServicesJoined, ServicesLeft

ONE_TASK = "task"
"""The first part of the topic of one task; its id follows after a space."""

MOST_NAMED, LONGEST_NAMED = 5, 100
"""How many of the unknown topics of a message are named, and how many characters of each."""

TOPICS: dict[str, tuple[Any, ...]] = {
    "map": (MapNews,),
    "ontology": (int,),
    "services": (ServicesJoined | ServicesLeft,),
    "fleet": (Devices, ErrorReport),
    "traffic": (Traffic, ErrorReport),
    "tasks": (TasksChanged,),
    ONE_TASK: (TaskChanged,),
    "templates": (),
    "orders": (),
    "people": (People,),
    "questions": (OpenQuestions,),
    "system": (SystemView,),
}
"""The types of the values of a topic's news, by the first part of the topic; without a type, news have no value."""


def is_topic(topic: str) -> bool:
    kind, _, id = topic.partition(" ")
    return bool(id) if kind == ONE_TASK else topic in TOPICS


def unknown_topics_text(topics: Iterable[str]) -> str:
    """Which of the topics do not exist, and which ones do; empty if all exist."""
    unknown = sorted({topic for topic in topics if not is_topic(topic)})
    if not unknown:
        return ""
    names = [f"{ONE_TASK} ID" if name == ONE_TASK else name for name in TOPICS]
    named_topics = " or ".join(topic[:LONGEST_NAMED] for topic in unknown[:MOST_NAMED])
    return f"there is no topic {named_topics}; the topics are {', '.join(names)}"


def allowed_topics(topics: Sequence[str], followed: Collection[str], bounds: Limits) -> tuple[list[str], str]:
    """Those of the topics that a WebSocket may follow, and why it may not follow the others; empty if it may follow all.

    `followed`: the topics that others follow already. Following them, too, costs little.
    """
    allowed: list[str] = []
    task_count, total = 0, sum(map(_is_of_task, followed))
    reasons = {unknown_topics_text(topics): None}
    for topic in dict.fromkeys(filter(is_topic, topics)):
        if _is_of_task(topic):
            is_further = topic not in followed
            if task_count == bounds.topics:
                reasons[f"a WebSocket follows at most {bounds.topics} tasks; `tasks` has the news of all"] = None
                continue
            if is_further and total == bounds.followed_tasks:
                reasons[f"{total} tasks are followed, which is the limit; try again later, or follow `tasks`"] = None
                continue
            task_count, total = task_count + 1, total + is_further
        allowed.append(topic)
    return allowed, ". ".join(filter(None, reasons))


def _is_of_task(topic: str) -> bool:
    return topic.startswith(f"{ONE_TASK} ")
