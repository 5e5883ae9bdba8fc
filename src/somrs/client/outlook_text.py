"""The outlook of a plan with foreseen steps as text: `from 12 EUR`, `12 to 20 EUR`."""

from __future__ import annotations

from somrs.protocol.messages.previews import Outlook


def outlook_price(outlook: Outlook, currency: str) -> str:
    """The range of the price; without an upper bound, where it begins."""
    least, most = f"{outlook.least_price:g}", f"{outlook.most_price:g}" if outlook.most_price is not None else None
    if most is None:
        return f"from {least} {currency}"
    return f"about {least} {currency}" if most == least else f"{least} to {most} {currency}"


def outlook_note(outlook: Outlook) -> str:
    """What the figures rely on."""
    if outlook.unknown:
        steps = f"step{'s' if len(outlook.unknown) > 1 else ''} {', '.join(id.removeprefix('step') for id in outlook.unknown)}"
        return f"without {steps}, for which no terms are known yet"
    return "foreseen steps count with the last terms of the services"
