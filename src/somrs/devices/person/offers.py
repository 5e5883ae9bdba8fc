"""What a person offers, as the attributes of the person's object on the map say: service types, prices, durations, and time to answer.

Anna: {type: Person, Price: 20 EUR, StepTime: 5 min, Offers: "TransferObject (4 EUR, 2 min), OpenDoor"}
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from msgspec import Struct

from somrs.errors import DeviceError
from somrs.ontology.objects import Object
from somrs.service_manager.sdk.values import money, seconds

OFFERS, PRICE, STEP_TIME, ANSWER_TIME = "Offers", "Price", "StepTime", "AnswerTime"
"""Attributes of a person: the service types, the price of a service, the duration of a step (s), the time to answer a request (s)."""
DEFAULT_PRICE = "20 EUR"
"""It is high, so that robots and cameras are preferred."""
DEFAULT_STEP_TIME = 600.0
DEFAULT_ANSWER_TIME = 600.0

_ITEM = re.compile(r"([^\W\d]\w*)\s*(?:\(([^()]*)\))?(?=[\s,]|$)")
_CURRENCY = re.compile(r"[A-Z]{3}")
_BETWEEN = " \t\n,"
_EXAMPLE = "write for example `TransferObject (4 EUR, 2 min), OpenDoor`"


class OfferedStep(Struct, frozen=True, kw_only=True):
    """A service type that a person offers. `price`, `duration`: as they are stated beside it; None: as for all services of the person."""

    service_type: str
    price: str | None = None
    duration: float | None = None


class PersonOffers(Struct, frozen=True, kw_only=True):
    """All that a person offers. Times are in seconds. `problems`: what is wrong in the attribute `Offers`; the rest of it counts."""

    steps: tuple[OfferedStep, ...] = ()
    price: float | str = DEFAULT_PRICE
    step_time: float = DEFAULT_STEP_TIME
    answer_time: float = DEFAULT_ANSWER_TIME
    problems: tuple[str, ...] = ()

    def step(self, service_type: str) -> OfferedStep:
        default = OfferedStep(service_type=service_type)
        return next((step for step in self.steps if step.service_type == service_type), default)

    def price_of(self, service_type: str) -> float | str:
        stated = self.step(service_type).price
        return stated if stated is not None else self.price


def read_offers(person: Object | None) -> PersonOffers:
    """What the person offers, by the values of the person's object; the defaults if it is not on the map."""
    values = person.values if person is not None else {}
    steps: list[OfferedStep] = []
    problems: list[str] = []
    for item in _items(str(values.get(OFFERS) or "")):
        if isinstance(item, str):
            problems.append(item)
        elif item.service_type not in [step.service_type for step in steps]:
            steps.append(item)
    price = values.get(PRICE)
    return PersonOffers(
        steps=tuple(steps),
        price=float(price) if isinstance(price, int | float) else DEFAULT_PRICE,
        step_time=_number(values.get(STEP_TIME), DEFAULT_STEP_TIME),
        answer_time=_number(values.get(ANSWER_TIME), DEFAULT_ANSWER_TIME),
        problems=tuple(problems),
    )


def _number(value: object, default: float) -> float:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else default


def _items(text: str) -> Iterator[OfferedStep | str]:
    """The service types in the text with their terms, and texts that say what is wrong."""
    rest = text.strip(_BETWEEN)
    while rest:
        match = _ITEM.match(rest)
        if match is None:
            yield f"Offers: {rest!r} does not begin with the name of a service type; {_EXAMPLE}"
            return
        yield _step(match[1], match[2] or "")
        rest = rest[match.end() :].strip(_BETWEEN)


def _step(service_type: str, terms: str) -> OfferedStep | str:
    price: str | None = None
    duration: float | None = None
    for term in filter(None, (part.strip() for part in terms.split(","))):
        if _is_price(term):
            price = term
            continue
        try:
            duration = seconds(term if not term.replace(".", "").isdigit() else "")
        except DeviceError:
            return f"Offers: {term!r} of {service_type} is neither a price nor a duration; {_EXAMPLE}"
    return OfferedStep(service_type=service_type, price=price, duration=duration)


def _is_price(text: str) -> bool:
    try:
        _, currency = money(text)
    except DeviceError:
        return False
    return text.endswith(currency) and _CURRENCY.fullmatch(currency) is not None
