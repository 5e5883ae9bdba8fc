"""What a task has cost so far, and when it will probably end."""

from __future__ import annotations

import pytest
from msgspec import structs

from somrs.client.task_forecast import Cost, cost, cost_text, remaining_text, remaining_time
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.task_views import Phase, StepView, TaskView, WorkView

NOW = 1000.0


def step(
    name: str, state: State, device: str = "A", *, after: tuple[str, ...] = (), duration: float = 30.0, fraction: float = 0.0
) -> StepView:
    service = f"{device}.Carry"
    return StepView(
        step=name,
        service_type="Carry",
        inputs={},
        after=after,
        state=state,
        service=service,
        price=4.0,
        duration=duration,
        fraction=fraction,
    )


def work(name: str, *, result: State | None = None, price: float | None = 4.0, currency: str = "EUR", began: float = NOW - 10) -> WorkView:
    state = result or State.EXECUTING
    return WorkView(
        step=name,
        service="A.Carry",
        service_type="Carry",
        inputs={},
        began=began,
        state=state,
        result=result,
        price=price,
        currency=currency,
    )


def view(*steps: StepView, works: tuple[WorkView, ...] = (), phase: Phase = Phase.EXECUTING, outcome: Outcome | None = None) -> TaskView:
    return TaskView(task="t", effect="A isOn B", phase=phase, submitted_at=0.0, steps=steps, work=works, outcome=outcome)


@pytest.mark.parametrize(
    ("steps", "seconds"),
    [
        # Until progress is reported, the time since the start counts.
        ((step("s1", State.EXECUTING),), 20.0),
        ((step("s1", State.EXECUTING, fraction=0.5),), 15.0),
        ((step("s1", State.EXECUTING, duration=5.0),), 0.0),
        # One after the other, because one needs the other, or because they have the same device; otherwise side by side.
        ((step("s1", State.EXECUTING), step("s2", State.COMMITTED, "B", after=("s1",))), 50.0),
        ((step("s1", State.EXECUTING), step("s2", State.COMMITTED, "A")), 50.0),
        ((step("s1", State.EXECUTING), step("s2", State.COMMITTED, "B")), 30.0),
        ((step("s1", State.COMPLETED), step("s2", State.COMMITTED, "B", after=("s1",))), 30.0),
        ((step("s1", State.COMPLETED),), 0.0),
    ],
)
def test_the_remaining_time_follows_terms_and_progress(steps: tuple[StepView, ...], seconds: float) -> None:
    assert remaining_time(view(*steps, works=(work("s1"),)), NOW) == seconds


def test_the_remaining_time_passes_and_is_not_guessed() -> None:
    running = view(step("s1", State.EXECUTING), works=(work("s1"),))
    assert [remaining_text(running, NOW + passed) for passed in (0, 5, 100)] == ["about 20 s", "about 15 s", "due now"]
    arranging = structs.replace(running, phase=Phase.ARRANGING)
    open_step = structs.replace(step("s2", State.NEW), service=None, duration=None)
    for unknown in (arranging, view(step("s1", State.EXECUTING), open_step)):
        assert (remaining_time(unknown, NOW), remaining_text(unknown, NOW)) == (None, "not known yet")
    assert remaining_text(view(phase=Phase.ENDED, outcome=Outcome.FAILED), NOW) == ""


def test_the_cost_is_of_completed_work_and_of_contracts() -> None:
    works = (work("s1", result=State.FAILED), work("s1", result=State.COMPLETED), work("s2", result=State.COMPLETED, price=6.0), work("s3"))
    steps = (step("s1", State.COMPLETED), step("s2", State.COMPLETED), step("s3", State.EXECUTING), step("s4", State.COMMITTED))
    running = view(*steps, works=works)
    assert cost(running) == Cost(completed={"EUR": 10.0}, contracted={"EUR": 8.0})
    assert cost_text(running) == "10 EUR so far, 8 EUR contracted"
    assert cost_text(structs.replace(running, outcome=Outcome.CANCELLED)) == "10 EUR"
    abroad = view(works=(work("s1", result=State.COMPLETED), work("s2", result=State.COMPLETED, price=0.5, currency="PLN")))
    assert cost_text(abroad) == "4 EUR + 0.5 PLN so far"
    assert cost_text(view(phase=Phase.PLANNING)) == "nothing so far"


def test_the_cost_of_a_record_without_prices_is_not_known() -> None:
    old = view(works=(work("s1", result=State.COMPLETED, price=None),), outcome=Outcome.ACCOMPLISHED)
    assert (cost(old), cost_text(old)) == (None, "")
