"""Run an author's coroutines, and convert their results to answers."""

from __future__ import annotations

import inspect
import logging
from collections.abc import Callable, Sequence

from somrs.entish.formula import Formula, conjunction, variables
from somrs.entish.parse import parse
from somrs.errors import DeviceError, RemoteError
from somrs.service_manager.sdk.device import AbilityCheck, Amount, Amounts, Device, Result, Service, Situation, Task
from somrs.service_manager.sdk.map_reader import Ask
from somrs.service_manager.sdk.orders import Halt, Order, Perform, Quote, Quoted, Refusal, ServiceFailed, Undo, Work, WorkDone
from somrs.service_manager.sdk.values import fill_in, money, seconds

log = logging.getLogger(__name__)


async def carry_out(device: Device, work: Work, ask: Ask, report: Callable[[object], None]) -> object:
    """Run the work and return its answer.

    Exceptions of the author's code are passed on; those other than Refusal and ServiceFailed are also logged.
    """
    service = device.find_service(work.order.method)
    if service is None:  # contracted before the device changed
        raise ServiceFailed(f"{device.name} does not offer this any more", tried=not isinstance(work, Perform))
    try:
        task = Task(device.name, work.order, ask, report, quoting=isinstance(work, Quote))
        match work:
            case Quote():
                try:
                    return await _quote(device, service, task)
                except RemoteError as error:  # the Repository, a world or the hardware does not answer
                    raise Refusal(str(error), not_now=True) from error
            case Perform(order):
                return _work_done(device, order, await service.performs(device, task), service)
            case Halt():
                return WorkDone(situation=_read(await service.stops(device, task), service) if service.stops else None)
            case Undo(_, situation):
                if service.undoes is None:
                    raise ServiceFailed(f"{device.name} cannot undo {service.name}")
                return WorkDone(situation=_read(await service.undoes(device, task, parse(situation)), service) or situation)
    except (Refusal, ServiceFailed):
        raise
    except Exception:  # an author's mistake may be anything; it is logged with its trace, and fails the service
        log.exception("%s: %s of %s", device.name, type(work).__name__, service.name)
        raise


async def _quote(device: Device, service: Service, task: Task) -> Quoted:
    if service.able is not None:
        await _check_ability(service.able, device, task)
    price, currency = money(await _amount(service.price, device, task))
    duration = seconds(await _amount(service.duration, device, task))
    penalty = money(await _amount(service.penalty, device, task))[0] if service.penalty is not None else None
    condition, invariant = _all_of(task.conditions), _all_of(task.invariants)
    return Quoted(price=price, currency=currency, duration=duration, condition=condition, penalty=penalty, invariant=invariant)


def _all_of(demands: Sequence[Formula]) -> str | None:
    return str(conjunction(*dict.fromkeys(demands))) if demands else None


async def _amount(amount: Amounts, device: Device, task: Task) -> Amount:
    if not callable(amount):
        return amount
    value = amount(device, task)
    return await value if inspect.isawaitable(value) else value


async def _check_ability(able: AbilityCheck, device: Device, task: Task) -> None:
    waiting = able(device, task)
    if inspect.isawaitable(waiting):
        await waiting


def _work_done(device: Device, order: Order, returned: Situation | Result, service: Service) -> WorkDone:
    """Return the answer for a service's result. A result without a situation stands for the effect."""
    result = returned if isinstance(returned, Result) else Result(outputs={}, situation=returned)
    situation = _read(result.situation, service)
    if situation is None:
        effect = fill_in(order.effect, device.name, order.inputs, result.outputs)
        if unknown := variables(effect):
            named = ", ".join(f"?{name}" for name in unknown)
            raise DeviceError(f"{service.name} has to return the situation, because its effect leaves {named} open: {effect}")
        situation = str(effect)
    return WorkDone(situation=situation, outputs=result.outputs, observation=result.observation)


def _read(situation: Situation, service: Service) -> str | None:
    """Return the situation as text, after checking that it is Entish."""
    if situation is None or isinstance(situation, str):
        return str(parse(situation)) if situation is not None else None
    if hasattr(situation, "__struct_fields__"):
        return str(situation)
    raise DeviceError(f"{service.name} has to return a situation in Entish, a Result or None, and returned {situation!r}")
