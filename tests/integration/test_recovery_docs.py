"""What docs/explanation/recovery.md and docs/reference/task-manager.md say of recovery, and of what is kept, is so."""

from __future__ import annotations

import re
import shlex

from somrs.cli.task_commands import handlers
from somrs.client.export import Table, columns
from somrs.ontology.files.loading import load_text, upper
from somrs.ontology.services import Occasion
from somrs.protocol.messages.event_kinds import EventKind
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.records import TaskRecord
from somrs.protocol.messages.task_views import ContractView, MessageView, StepView, TaskEvent, WorkView
from somrs.service_manager.participant import messaging
from somrs.task_manager.arrangement import call_for_proposals
from somrs.task_manager.execution import participants
from somrs.task_manager.recovery import ladder
from somrs.task_manager.transaction import ending
from tests.support.paths import ROOT
from tests.support.virtual_system import Robot, VirtualSystem

DOCS = ROOT / "docs"
TEXT = (DOCS / "explanation" / "recovery.md").read_text()


def test_the_command_lays_down_what_is_said_of_it() -> None:
    command = re.search(r"^somrs do .*?(?=\n```)", TEXT, re.DOTALL | re.MULTILINE)
    assert command is not None
    words = shlex.split(command[0].replace("\\\n", " "))
    options = {option: words[words.index(option) + 1] for option in ("--on-failure", "--on-compensation")}
    failure, compensation = handlers([options["--on-failure"]], [options["--on-compensation"]])
    assert (failure.service_type, failure.when) == ("TransferObject", "?Object isOn Floor001")
    assert (compensation.on, compensation.service_type, compensation.when) == (Occasion.COMPENSATION, None, None)
    system = VirtualSystem(Robot("Robot1", 1, 10))
    assert system.submit(words[2], handlers=(failure,))


def test_the_type_of_service_can_be_read() -> None:
    (block,) = [text for text in re.findall(r"```yaml\n(.*?)```", TEXT, re.DOTALL) if "handlers:" in text]
    service = load_text(block, "docs/explanation/recovery.md", upper()).ontology.services["CarryGlass"]
    assert [handler.on for handler in service.handlers] == [Occasion.FAILURE, Occasion.COMPENSATION]
    assert service.handlers[0].when == "?Object isOn Floor001"


def test_the_words_and_the_limits_are_those_of_the_program() -> None:
    for kind in EventKind:
        assert f"`{kind.value}`" in TEXT, kind
    for state in (State.COMPLETED, State.COMPENSATED, State.STRANDED, State.UNREACHABLE):
        assert f"`{state.value}`" in TEXT, state
    for name, value in {
        "REPLY_TIME": call_for_proposals.REPLY_TIME,
        "SILENCE": participants.SILENCE,
        "CUT_OFF": messaging.CUT_OFF,
        "LATENESS": participants.LATENESS,
        "LEAST_TIME": participants.LEAST_TIME,
        "STOP_TIME": ending.STOP_TIME,
        "MOST_REPLANS": ladder.MOST_REPLANS,
    }.items():
        (row,) = [line for line in TEXT.splitlines() if f"`{name}`" in line and line.startswith("|")]
        assert re.search(rf"\b{value:g}\b", row), row
    assert 2 * participants.SILENCE > messaging.CUT_OFF


def test_every_field_of_what_is_kept_is_explained() -> None:
    text = (DOCS / "reference" / "task-manager.md").read_text()
    section = text.partition("## Records of ended tasks")[2].partition("\n## ")[0]
    for kind in (TaskRecord, StepView, WorkView, ContractView, TaskEvent, MessageView):
        for name in kind.__struct_fields__:
            assert f"`{name}`" in section, f"{kind.__name__}.{name}"
    for name in set(columns(Table.TASKS)) - {*TaskRecord.__struct_fields__}:
        assert f"`{name}`" in section, name
