"""One assignment on the page of a person: what to do, in words, and the replies that fit its state."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.client.durations import format_duration
from somrs.devices.person.answers import unknown_objects
from somrs.devices.person.assignments import Assignment, Reply, ReplyKind
from somrs.devices.person.wording import title
from somrs.entish.parse import parse
from somrs.errors import UsageError
from somrs.gui.components.rebuilt import RebuiltElement
from somrs.gui.pages.person.finding_form import FindingForm
from somrs.gui.pages.person.outcome_choice import OutcomeChoice
from somrs.gui.shell import guarded, notify

_STOPPED = "This is not needed any more. Please stop, put down safely what you hold, and say what is so now."


class AssignmentCard:
    """An assignment with its replies. What is being written stays while other assignments come and go."""

    def __init__(self, api: LiveApi, assignment: Assignment) -> None:
        self._api, self._assignment = api, assignment
        work = assignment.work
        classes = "somrs-question somrs-person-work" + (" somrs-person-stop" if work.stops else "")
        with ui.element("section").classes(classes).props(f'aria-label="Assignment {assignment.number}"') as self.element:
            self._build_head()
            self._build_facts()
            if work.stops:
                self._outcome = OutcomeChoice(api, work.outcomes, work.effect)
                with ui.element("div").classes("somrs-person-replies"):
                    self._button("Send", guarded(self._stopped), main=True)
                return
            with ui.element("div").classes("somrs-person-finding") as self._finding_element:
                self._finding = FindingForm(api, work)
            self._replies = RebuiltElement().classes("somrs-person-replies")
            with ui.element("div").classes("somrs-person-trouble") as self._trouble:
                self._reason = ui.input("Why not?").props("outlined dense")
                outcomes = [outcome for outcome in work.outcomes if outcome.situation != work.effect]
                self._outcome = OutcomeChoice(api, outcomes, work.effect)
                with ui.element("div").classes("somrs-person-replies"):
                    self._button("Send", guarded(self._could_not), main=True)
                    self._button("Back", lambda: self._open_trouble(False))
        self._trouble.visible = False
        self.show(assignment)

    def _build_head(self) -> None:
        work = self._assignment.work
        name = title(work.service_type)
        with ui.element("div").classes("somrs-question-head"):
            ui.icon("front_hand" if work.stops else "undo" if work.undoes else "assignment").props('aria-hidden="true"')
            heading = f"Stop: {name}" if work.stops else f"Undo: {name}" if work.undoes else name
            ui.label(heading).props('role="heading" aria-level="2"')
            self._age = ui.label().classes("somrs-soft")
        definition = self._api.context.ontology.services.get(work.service_type)
        if work.stops:
            ui.label(_STOPPED)
        elif work.undoes:
            ui.label("What was done before is not wanted any more. Please bring it back.")
        elif definition is not None and definition.doc:
            ui.label(definition.doc.rstrip(".") + ".")

    def _build_facts(self) -> None:
        work = self._assignment.work
        facts = {title(name): text for name, text in work.inputs.items() if text not in work.objects}
        if work.present and not work.stops:
            facts["Now"] = _capital(work.present)
        finds_out = work.open_variables or unknown_objects(parse(work.effect))
        facts["Was asked" if work.stops else "Find out" if finds_out else "In the end"] = _capital(work.aim or work.effect)
        with ui.element("dl").classes("somrs-person-facts"):
            for name, text in facts.items():
                with ui.element("dt"):
                    ui.label(name)
                with ui.element("dd"):
                    ui.label(text)

    def show(self, assignment: Assignment) -> None:
        self._assignment = assignment
        if not assignment.work.stops:
            accepted = assignment.accepted is not None
            self._finding_element.visible = accepted and self._finding.is_needed
            self._replies.show(accepted, self._build_replies)
        self.tick()

    def tick(self) -> None:
        assignment = self._assignment
        since = assignment.accepted or assignment.asked
        age = format_duration(max(0.0, time.time() - since))
        self._age.set_text(f"{'accepted' if assignment.accepted else 'asked'} {age} ago")

    def _button(self, label: str, action: Callable[[], object], *, main: bool = False) -> None:
        ui.button(label, on_click=action).props("unelevated no-caps color=primary size=lg" if main else "flat no-caps")

    def _build_replies(self) -> None:
        if self._assignment.accepted is None:
            self._button("Accept", guarded(partial(self._send, Reply(kind=ReplyKind.ACCEPT))), main=True)
            self._button("Not now", guarded(partial(self._send, Reply(kind=ReplyKind.NOT_NOW))))
            self._button("Decline", guarded(partial(self._send, Reply(kind=ReplyKind.DECLINE))))
        else:
            self._button("Done", guarded(self._done), main=True)
            self._button("I could not", lambda: self._open_trouble(True))

    def _open_trouble(self, is_open: bool) -> None:
        self._trouble.visible, self._replies.visible = is_open, not is_open
        self._finding_element.visible = not is_open and self._finding.is_needed
        if is_open:
            self._reason.run_method("focus")

    async def _done(self) -> None:
        await self._send(self._finding.reply())

    async def _could_not(self) -> None:
        if not self._outcome.is_chosen:
            raise UsageError("Choose what is so now.")
        reason = str(self._reason.value or "").strip()
        await self._send(Reply(kind=ReplyKind.COULD_NOT, reason=reason, situation=self._outcome.situation))

    async def _stopped(self) -> None:
        if not self._outcome.is_chosen:
            raise UsageError("Choose what is so now.")
        await self._send(Reply(kind=ReplyKind.COULD_NOT, situation=self._outcome.situation))

    async def _send(self, reply: Reply) -> None:
        window = ui.context.client
        await self._api.people.reply(self._assignment.number, reply)
        with window:  # the assignment may be closed and this card removed by now
            notify("Thank you." if reply.kind is ReplyKind.DONE or self._assignment.work.stops else "Sent.")


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
