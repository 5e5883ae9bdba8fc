"""Tables in a terminal: nothing is cut off, however narrow it is."""

from __future__ import annotations

import io
from collections import Counter

import pytest
from rich.console import Console, Group, RenderableType
from rich.progress_bar import ProgressBar
from rich.text import Text

from somrs.client import terminal
from somrs.ontology.files.loading import upper
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.task_views import StepView, WorkView

WIDTHS = (20, 28, 40, 60, 72, 80, 100, 130, 200)


def print_at(width: int, renderable: RenderableType) -> str:
    console = Console(width=width, file=io.StringIO(), record=True)
    console.print(renderable)
    return console.export_text()


def assert_shown(texts: list[str], output: str) -> None:
    missing = Counter("".join(texts)) - Counter(output)
    assert missing.keys() <= {" ", "\n"}, f"{missing} is missing in\n{output}"


def test_a_title_is_in_one_line_where_the_terminal_has_room() -> None:
    goal = "Valve1.Pressure = ?p AND Skylight1.Shut = TRUE"
    table = terminal.table(goal, ["?p"], [["3 bar"]])
    for width, is_whole in ((80, True), (30, False)):
        assert (goal in print_at(width, table)) is is_whole


@pytest.mark.parametrize("width", WIDTHS)
def test_the_services_on_offer_are_shown_whole(width: int) -> None:
    offers = [
        Offer(
            service=f"Robot1.{service_type.name}",
            provider="Robot1",
            provider_type="PioneerP3DX",
            address="http://here/Robot1",
            service_type=service_type,
            attributes={"OperationRange": 0.45, "Price": 1.5},
        )
        for service_type in upper().services.values()
    ]
    shown = [text for o in offers for text in (o.service, o.service_type.effect, o.service_type.precondition or "", *o.attributes)]
    output = print_at(width, terminal.services(offers))
    assert_shown([*shown, "Services on offer", "service and attributes", "effect", "precondition"], output)
    assert max(map(len, output.splitlines())) <= width
    words = {word for offer in offers for word in (offer.service_type.precondition or "").split()}
    if width >= 60:
        assert {word for word in words if word not in output} == set(), "words are not cut"
    if width >= 80:
        assert all(offer.service in output for offer in offers)
        assert "─" in output, "the cells are side by side"


@pytest.mark.parametrize("width", WIDTHS)
def test_a_plan_in_execution_is_shown_whole(width: int) -> None:
    inputs = {"Object": "Carton001", "Destination": "Shelf001"}
    step = StepView(step="step1", service_type="TransferObject", inputs=inputs, state=State.COMPLETED)
    running = StepView(step="step2", service_type="MoveTo", inputs={}, state=State.EXECUTING, after=("step1",), fraction=0.5)
    work = WorkView(
        step="look1", service="Patrol1.RecognizeSituation", service_type="RecognizeSituation", inputs={}, began=0.0, state=State.EXECUTING
    )
    output = print_at(width, terminal.steps("[Plan]", (step, running), (work,)))
    assert_shown(["[Plan]", "TransferObject", "Object: Carton001", "✔ Completed", "Executing 50 %", work.service], output)


def test_a_cell_is_printed_as_it_is() -> None:
    rows = [["[red]", Group(Text("halfway"), ProgressBar(total=1.0, completed=0.5, width=14))]]
    for width in (60, 20):
        output = print_at(width, terminal.table("", ["text", "progress"], rows))
        assert "[red]" in output
        assert "halfway" in output
        assert output.count("━") == 7, "half of the bar; the rest is a colour"
