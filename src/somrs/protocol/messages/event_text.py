"""Sentences for the events of tasks, for people. No program parses them."""

from __future__ import annotations

from collections.abc import Iterable

from somrs.protocol.messages import events, waits
from somrs.protocol.messages.events import ComparedPlan, Event
from somrs.protocol.messages.people import person_name
from somrs.protocol.messages.task_views import Pause
from somrs.protocol.messages.waits import Holder


def join_reasons(reasons: Iterable[str]) -> str:
    """Join the reasons to one line."""
    return "; ".join(reasons)


def short_id(task: str) -> str:
    """Return a short form of a task's id, which people can enter instead of the id."""
    return task.rpartition(":")[2][:8]


def waiting_text(event: waits.WaitsForTasks) -> str:
    """Return for which tasks a task waits, and which objects they have reserved."""
    return f"waiting for {', and for '.join(f'{_task_text(holder)}, which {reserved_text(holder)}' for holder in event.known_holders)}"


def retry_text(event: waits.WaitsToRetry) -> str:
    """Return why there is no way to do a task now, with the number of attempts. Services with the same reason are named together."""
    subjects_by_reason: dict[str, list[str]] = {}
    for hindrance in event.hindrances:
        subjects_by_reason.setdefault(hindrance.reason, []).append(hindrance.subject)
    reasons = join_reasons(f"{', '.join(subjects)}: {reason}" for reason, subjects in subjects_by_reason.items())
    count = f" ({event.attempts} attempts)" if event.attempts > 1 else ""
    return f"waiting to try again{count}: {reasons}"


def awaited_text(event: waits.WaitsForRepository) -> str:
    """Return whose answer a task waits for."""
    subject = f" about {', '.join(event.objects)}" if event.objects else ""
    return f"waiting for an answer{subject}: {repository_text(event.map)} does not answer"


def repository_text(map: str) -> str:
    """Return the Repository that has a map; without a name, that of the Task Manager."""
    return f"the Repository of {map}" if map else "the Repository"


def holders_text(holders: Iterable[Holder]) -> str:
    """Return which tasks have reserved which objects."""
    return " and ".join(f"{_task_text(holder)} {reserved_text(holder)}" for holder in holders)


def reserved_text(holder: Holder) -> str:
    """Return what a task has reserved, for a context that already names the task."""
    objects = ", ".join(holder.objects)
    return f"waits for {objects} too and comes first" if holder.waiting else f"has reserved {objects}"


def _task_text(holder: Holder) -> str:
    return f"task {short_id(holder.task)}" + (f" ({holder.goal})" if holder.goal else "")


def compared_plan_text(plan: ComparedPlan) -> str:
    """Return the service types of a plan, its price and its duration."""
    types = ", ".join(plan.service_types)
    if plan.price is None or plan.seconds is None:
        return f"{types}: not every step has terms"
    return f"{types} for {plan.price:g} {plan.currency}, in {plan.seconds:.0f} s"


def pause_text(pause: Pause) -> str:
    """Who has paused a task, for people."""
    return f"paused by {person_name(pause.by)}; its devices stand still until somebody lets it go on"


def done_text(doubts: Iterable[str]) -> str:
    """That a goal holds already. `doubts`: the problems of devices that it is about."""
    return "; ".join(("nothing to do: it is so already", *(f"but {doubt}, so this may be old" for doubt in doubts)))


def sentence(event: Event) -> str:
    """Return the event as a sentence."""
    match event:
        case events.TaskStated(effect=effect):
            return f"task: {effect}"
        case events.Planned(steps=0, doubts=doubts):
            return done_text(doubts)
        case events.Planned(steps=count, foreseen=foreseen):
            plan = f"planned: {count} step{'s' if count != 1 else ''}"
            dependent = "depends" if foreseen == 1 else "depend"
            return f"{plan}, of which {foreseen} {dependent} on what the others find out" if foreseen else plan
        case waits.WaitsForTasks():
            return waiting_text(event)
        case waits.WaitsToRetry():
            return retry_text(event)
        case waits.WaitOver(attempts=attempts, seconds=seconds):
            return f"continuing after {seconds:.0f} s and {attempts} attempt{'s' if attempts != 1 else ''}"
        case waits.GoesOn():
            return "continuing: the objects it waited for are free"
        case waits.WaitsForRepository():
            return awaited_text(event)
        case waits.RepositoryAnswered(seconds=seconds, map=map):
            return f"continuing: {repository_text(map)} has answered after {seconds:.0f} s"
        case events.Replanned(reasons=reasons):
            return f"replanning: {join_reasons(reasons)}"
        case events.ConditionsAdopted(conditions=conditions):
            return f"replanning with what services need: {', '.join(f'{condition} ({name})' for name, condition in conditions.items())}"
        case events.TriedOnceMore(services=services):
            return f"there is no plan without {', '.join(services)}; they may try again"
        case events.Paused(author=author):
            return f"paused by {person_name(author)}"
        case events.Resumed(author=author):
            return f"going on, says {person_name(author)}"
        case events.Stopping(reason=reason):
            return f"stopping: {reason}"
        case events.TaskEnded(outcome=outcome, reasons=reasons):
            return f"{outcome}: {join_reasons(reasons)}" if reasons else f"{outcome}"
        case _:
            return _of_step(event)


def _of_step(event: Event) -> str:
    match event:
        case events.ServicesAsked(services=services):
            return f"asking {', '.join(services)}"
        case events.UndoingCheaper(undoing=undoing, going_on=going_on):
            return f"undoing what the failure left is estimated at {undoing:.2f}, going on from there at {going_on:.2f}: undoing it first"
        case events.PlansCompared(plans=plans, chosen=chosen):
            texts = [compared_plan_text(plan) + (" (chosen)" if number == chosen else "") for number, plan in enumerate(plans)]
            return f"compared {len(plans)} plans: {'; '.join(texts)}"
        case events.TermsOffered(service=service, price=price, currency=currency, duration=duration, condition=condition):
            return f"{service} offers {price:g} {currency}, {duration:.0f} s" + (f", if {condition}" if condition is not None else "")
        case events.ServiceRefused(service=service, reason=reason, not_now=not_now, condition=condition):
            possible = f"; it would do it if {condition}" if condition is not None else ""
            return f"{service} refuses{' for now' if not_now else ''}: {reason}{possible}"
        case events.ServiceChosen(service=service, price=price, currency=currency, duration=duration):
            return f"{service} does it for {price:g} {currency}, in {duration:.0f} s"
        case waits.WaitsForDevice(device=device):
            return f"waiting for its turn at {device}"
        case events.StepStarted(service=service):
            return f"{service} starts"
        case events.ProgressNoted(service=service, note=note):
            return f"{service}: {note}"
        case events.StepCompleted(service=service, situation=situation):
            return f"{service} completed: {situation}"
        case events.FoundOut(service=service, situation=situation, outputs=outputs):
            told = situation or ", ".join(f"{name} = {value}" for name, value in outputs.items())
            return f"{service} found out: {told}"
        case events.StepStopped(service=service):
            return f"{service} stopped"
        case events.ReportSuperseded(service=service, parts=parts):
            return f"{service} reports old news, and the map keeps what is newer: {join_reasons(parts)}"
        case events.ObjectsDiscovered(service=service, objects=objects):
            return f"{service} discovered {', '.join(objects)}, new on the map"
        case events.FoundSo():
            return "the effect of the step holds after all"
        case _:
            return _of_failure(event)


def _of_failure(event: Event) -> str:
    match event:
        case events.ServiceFaulted(service=service, text=text):
            return f"{service}: {text}"
        case events.ReportRejected(service=service, problems=problems):
            return f"the Repository rejects what {service} reports: {join_reasons(problems)}"
        case _ if isinstance(event, events.ServiceFailure):
            return f"{event.service} {failure_text(event)}"
        case _:
            return _of_recovery(event)


def failure_text(event: events.ServiceFailure) -> str:
    """Return what went wrong with a service, for a context that already names the service."""
    match event:
        case events.NotBegun(description=description):
            return f"did not begin: {description}"
        case events.StepFailed(description=description):
            return f"failed: {description}"
        case events.ServiceFaulted(text=text):
            return text
        case events.ContractForgotten():
            return "has forgotten its contract"
        case events.ServiceSilent():
            return "is silent; asking for its state"
        case events.ServiceOverdue(undoing=True):
            return "takes far too long to undo its work; releasing it"
        case events.ServiceOverdue():
            return "takes far longer than its terms say; stopping it"
        case events.InvariantBroken(invariant=invariant):
            return f"is being stopped: {invariant} does not hold any more"
        case events.ServiceLost():
            return f"{loss_text(event)}; nothing is known of what it left"
        case events.ReportRejected(problems=problems):
            return f"the Repository rejects what it reports: {join_reasons(problems)}"
        case events.CompensationFailed(description=description):
            return f"could not undo it: {description}"


def loss_text(event: events.ServiceLost) -> str:
    """Return why it is unknown what the service left."""
    if event.silent:
        return "fell silent while it worked"
    return "did not report that it stopped" if event.stopping else "did not come to an end"


def _of_recovery(event: Event) -> str:
    match event:
        case events.ServiceReplaced():
            return "replacing the service"
        case events.MayTryAgain(services=services):
            return f"no other service can do it: {', '.join(services)} may try again"
        case events.HandlerBegun(effect=effect):
            return f"the step failed; its handler is to achieve: {effect}"
        case events.GoalFailed(goal=goal, step=step, reasons=reasons):
            return f"{goal} for {step}: {join_reasons(reasons)}"
        case events.LookBegun(service_type=service_type, object=object):
            return f"{service_type}: a service is to observe {object}"
        case events.LookFound(situation=situation):
            return f"observed: {situation or 'nothing'}"
        case events.NobodyLooks(object=object):
            return f"no service can observe {object}: nothing is assumed about it"
        case events.KnownOtherwise(object=object, problems=problems):
            return f"the map has newer facts about {object}: {join_reasons(problems)}"
        case events.FailuresUndone(reasons=reasons):
            return f"{join_reasons(reasons)}; undoing what failed"
        case events.UndoneByHandler(effect=effect):
            return f"undoing it by its handler: {effect}"
        case events.UndoneByService(service=service, situation=situation):
            return f"{service} is to restore {situation}"
        case events.UndoneByOthers(situation=situation):
            return f"other services are to restore {situation}"
        case events.Compensated(service=service, situation=situation):
            return f"{service} compensated: {situation}"
        case events.WorkUndone():
            return "is undone"
        case events.WorkStranded(taken=True, holders=holders):
            return f"is not undone: {holders_text(holders) or 'another task has reserved the objects'}"
        case events.WorkStranded(reason=reason):
            return f"could not be undone: {reason or 'no service restores it'}"
    raise AssertionError(f"there is no sentence for {type(event).__name__}")
