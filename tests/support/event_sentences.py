"""The events of a task as sentences for people."""

from somrs.protocol.messages.event_text import sentence
from somrs.task_manager.transaction.state import TaskState


def texts(task: TaskState) -> list[str]:
    return [sentence(noted.event) for noted in task.events]
