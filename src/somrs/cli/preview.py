"""The preview of a task, for the terminal: its plan and, with quotes, the terms of services and the total."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from rich.console import Group, RenderableType
from rich.text import Text

from somrs.cli.running_site import site_addresses
from somrs.client import terminal
from somrs.client.client import Client
from somrs.client.outlook_text import outlook_note, outlook_price
from somrs.client.task_report import reasons
from somrs.protocol.messages.previews import OtherPlan, Preview, Previewed, Quotation


async def plan(request: Preview, data: Path, *, json: bool) -> int:
    """Print the plan. Returns the exit status: 0 if there is a plan, or nothing to do."""
    async with Client(await site_addresses(data)) as client:
        result = await client.preview(request)
    if json:
        terminal.print_json(result)
    elif not result.steps:
        print("\n".join(reasons(result)))
    else:
        terminal.console().print(_preview(result, quoted=request.quotes))
    return 0 if result.steps or not result.reasons else 1


def _preview(result: Previewed, *, quoted: bool) -> Group:
    parts: list[RenderableType] = [terminal.plan(result.steps)]
    if quoted:
        parts += ["", _quotations(result.quotations), "", _total(result)]
        if result.alternatives:
            parts += ["", _alternatives(result)]
    if result.waits:
        parts.append(Text(f"A task would begin by {result.waits}."))
    return Group(*parts)


def _quotations(offered_quotations: Iterable[Quotation]) -> RenderableType:
    """The terms of the services for each step; ✔ marks the service that would be chosen."""
    quotation_list = [*offered_quotations]
    rows = (
        (
            quotation.step,
            Text(f"{'✔ ' if quotation.chosen else ''}{quotation.service}", "green" if quotation.chosen else ""),
            terminal.terms(quotation.price, quotation.currency, quotation.duration) or "-",
            f"{quotation.start:.0f} s to {quotation.finish:.0f} s" if quotation.start is not None and quotation.finish is not None else "-",
            terminal.lines(
                "an estimate: its last known terms" if quotation.estimate else "",
                f"only if {quotation.condition}" if quotation.condition is not None else "",
                quotation.reason,
            ),
        )
        for quotation in quotation_list
    )
    columns = ("step", "service (✔ chosen)", "terms", "start, finish", "note")
    return terminal.table("Current terms", columns, rows, whole=("terms",))


def _alternatives(result: Previewed) -> RenderableType:
    """All plans side by side; the policy prefers the first."""
    plans: list[Previewed | OtherPlan] = [result, *result.alternatives]
    rows = (
        (
            Text(", ".join(step.service_type for step in plan.steps), "green" if plan is result else ""),
            Text(", ".join(step.service or "nobody" for step in plan.steps)),
            _plan_terms(plan) or "not every step has terms",
        )
        for plan in plans
    )
    return terminal.table("Plans (the first is preferred)", ("steps", "services", "terms"), rows, whole=("terms",))


def _plan_terms(plan: Previewed | OtherPlan) -> str:
    if plan.outlook is not None:
        return f"{outlook_price(plan.outlook, plan.currency)}, from {plan.outlook.least_seconds:.0f} s"
    return terminal.terms(plan.price, plan.currency, plan.seconds)


def _total(result: Previewed) -> Text:
    """The total price and time, or the steps that no service would do."""
    if result.unserved:
        return Text("\n".join(f"{step}: {reason}" for step, reason in result.unserved.items()), "red")
    if (outlook := result.outlook) is not None:
        text = f"Total: {outlook_price(outlook, result.currency)}, done in {outlook.least_seconds:.0f} s at the earliest"
        return Text(f"{text}; {outlook_note(outlook)}.", "bold")
    price = f"{result.price:g} {result.currency}" if result.price is not None else "prices in several currencies"
    seconds = f", done in {result.seconds:.0f} s" if result.seconds is not None else ""
    return Text(f"Total: {price}{seconds}{'; partly an estimate' if result.estimate else ''}.", "bold")
