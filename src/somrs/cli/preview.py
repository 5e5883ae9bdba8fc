"""What a task would come to, for the terminal: its plan, and, where services were asked, who would do each step and what it costs."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from rich.console import Group, RenderableType
from rich.text import Text

from somrs.client import terminal
from somrs.client.client import Addresses, Client
from somrs.client.task_report import reasons
from somrs.protocol.messages.clients import Preview, Previewed, Quotation


async def plan(wanted: Preview, data: Path, *, json: bool) -> int:
    """Show the plan; 0 if there is one, or nothing to do."""
    async with Client(Addresses.read(data)) as client:
        found = await client.preview(wanted)
    if json:
        terminal.print_json(found)
    elif not found.steps:
        print("\n".join(reasons(found)))
    else:
        terminal.console().print(preview(found, quoted=wanted.quotes))
    return 0 if found.steps or not found.reasons else 1


def preview(found: Previewed, *, quoted: bool) -> Group:
    parts: list[RenderableType] = [terminal.plan(found.steps)]
    if quoted:
        parts += ["", quotations(found.quotations), "", total(found)]
    if found.waits:
        parts.append(Text(f"A task would begin by {found.waits}."))
    return Group(*parts)


def quotations(found: Iterable[Quotation]) -> RenderableType:
    """Who was asked for a step, and what each wants; ✔ would get it."""
    asked = [*found]
    rows = (
        (
            one.step,
            Text(f"{'✔ ' if one.chosen else ''}{one.service}", "green" if one.chosen else ""),
            terminal.terms(one.price, one.currency, one.duration) or "-",
            f"{one.start:.0f} s to {one.finish:.0f} s" if one.start is not None and one.finish is not None else "-",
            terminal.lines("an estimate: it asked this last" if one.estimate else "", one.reason),
        )
        for one in asked
    )
    columns = ("step", "asked (✔ chosen)", "offers", "from, until", "but")
    return terminal.table(
        "Terms now", columns, rows, whole=("offers",), least={columns[1]: terminal.column_width(f"✔ {one.service}" for one in asked)}
    )


def total(found: Previewed) -> Text:
    """What all of it comes to."""
    if found.unserved:
        return Text("\n".join(f"{step}: {why}" for step, why in found.unserved.items()), "red")
    price = f"{found.price:g} {found.currency}" if found.price is not None else "prices in several currencies"
    seconds = f", done in {found.seconds:.0f} s" if found.seconds is not None else ""
    return Text(f"All together: {price}{seconds}{'; some of it is an estimate' if found.estimate else ''}.", "bold")
