"""The topics of the API's news."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from somrs.api.fleet import Devices
from somrs.api.map_news import MapNews
from somrs.api.people import People
from somrs.api.questions import OpenQuestions
from somrs.api.system import SystemView
from somrs.api.task_feed import TaskChanged, TasksChanged
from somrs.api.traffic import Traffic
from somrs.client.refusals import ErrorReport
from somrs.protocol.messages.directory import ServicesJoined, ServicesLeft

ONE_TASK = "task"
"""The first part of the topic of one task; its id follows after a space."""

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
    return f"there is no topic {' or '.join(unknown)}; the topics are {', '.join(names)}"
