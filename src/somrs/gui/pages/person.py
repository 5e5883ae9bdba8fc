"""The page of a person who does steps of tasks, for a phone: what to do and where, and the replies. It is found by a link or a code."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

from nicegui import ui

from somrs.api.people import Availability, People, PersonView
from somrs.api.remote import LiveApi
from somrs.client.durations import format_duration
from somrs.client.hub import News
from somrs.devices.person.assignments import Assignment, Reply, ReplyKind
from somrs.entish.formula import Name, Relation, conjuncts
from somrs.entish.parse import parse
from somrs.gui.components.floorplan import FloorPlan
from somrs.gui.components.rebuilt import RebuiltElement
from somrs.gui.news import follow
from somrs.gui.question_panel import QuestionPanel
from somrs.gui.shell import guarded, notify, page

PATH = "/person"


def register(api: LiveApi) -> None:
    @ui.page(PATH)
    async def show_entrance() -> None:
        with page("Your page", PATH, api, navigation=False):
            _Entrance(api)

    @ui.page(PATH + "/{code}")
    async def show_page(code: str) -> None:
        with page("Your page", PATH, api, navigation=False):
            person = _find(await api.people.list(), code)
            if person is None:
                _Entrance(api, f"There is no page with the code {code}.")
            else:
                _PersonPage(api, person)


def _find(people: People, code: str) -> PersonView | None:
    return next((person for person in people.people if person.code is not None and person.code == code.strip().upper()), None)


class _Entrance:
    """Asks for the code of the page."""

    def __init__(self, api: LiveApi, problem: str = "") -> None:
        self._api = api
        with ui.element("section").classes("somrs-sheet somrs-person").props('aria-label="Code"'):
            ui.label("Your page").classes("somrs-title").props('role="heading" aria-level="1"')
            ui.label("Enter your code. Whoever runs the system finds it on the Fleet page, at your name.")
            self._problem = ui.label(problem).classes("somrs-trouble").props('role="alert"')
            self._problem.visible = bool(problem)
            self._code = ui.input("Code").props("outlined autocapitalize=characters autocomplete=off")
            self._code.on("keydown.enter", guarded(self._enter))
            ui.button("Open", on_click=guarded(self._enter)).props("unelevated no-caps color=primary size=lg")

    async def _enter(self) -> None:
        code = str(self._code.value or "")
        if _find(await self._api.people.list(), code) is None:
            self._problem.set_text(f"There is no page with the code {code.strip()}." if code.strip() else "Enter the code first.")
            self._problem.visible = True
            return
        ui.navigate.to(f"{PATH}/{code.strip().upper()}")


class _PersonPage:
    """The page's content, updated in place: a reply that is being written stays while other assignments come and go."""

    def __init__(self, api: LiveApi, person: PersonView) -> None:
        self._api, self._person = api, person
        self._cards: dict[int, _AssignmentCard] = {}
        self._shown: tuple[str, ...] | None = None
        with ui.element("div").classes("somrs-person"):
            with ui.element("header").classes("somrs-person-head"):
                ui.label(person.label or person.name).classes("somrs-title").props('role="heading" aria-level="1"')
                self._available = ui.switch("Available", on_change=guarded(self._set_available))
            self._status = ui.label().classes("somrs-soft").props('role="status"')
            QuestionPanel(api, person=person.name)
            self._list = ui.element("div").classes("somrs-person-list").props('aria-live="polite"')
            with ui.element("section").classes("somrs-sheet somrs-person-plan").props('aria-label="Where"') as self._where:
                self._plan = FloorPlan(mode="view").classes("somrs-person-floor")
        self._show(person)
        ui.timer(10.0, self._tick)
        follow(api.context.hub, "people", self._read, self._on_news)

    async def _read(self) -> None:
        self._show_people(await self._api.people.list())

    async def _on_news(self, news: News) -> None:
        if isinstance(news.value, People):
            self._show_people(news.value)
        else:
            await self._read()

    def _show_people(self, people: People) -> None:
        person = next((person for person in people.people if person.name == self._person.name), None)
        if person is not None:
            self._show(person)

    def _show(self, person: PersonView) -> None:
        self._person = person
        self._available.set_value(person.available)
        assignments = {assignment.number: assignment for assignment in person.assignments}
        for number in [number for number in self._cards if number not in assignments]:
            self._cards.pop(number).element.delete()
        with self._list:
            for number, assignment in assignments.items():
                if (card := self._cards.get(number)) is None:
                    self._cards[number] = _AssignmentCard(self._api, assignment)
                else:
                    card.show(assignment)
        if not person.available:
            text = "You are not available: nobody asks you to do anything."
        elif assignments:
            text = f"{len(assignments)} thing{'s' if len(assignments) != 1 else ''} to do"
        else:
            text = "There is nothing to do. New requests appear here by themselves."
        self._status.set_text(text)
        ui.page_title(f"({len(assignments)}) Your page · SO-MRS" if assignments else "Your page · SO-MRS")
        self._mark(person.assignments)

    def _mark(self, assignments: tuple[Assignment, ...]) -> None:
        """Show where the first assignment is."""
        self._where.visible = bool(assignments)
        objects = tuple(assignments[0].work.objects) if assignments else ()
        if objects == self._shown:
            return
        self._shown = objects
        self._plan.highlight(dict.fromkeys(objects, ""))
        self._plan.point(_arrows(assignments[0].work.effect) if assignments else [])
        if objects:
            self._plan.show_object(objects[0])

    def _tick(self) -> None:
        for card in self._cards.values():
            card.tick()

    async def _set_available(self) -> None:
        available = bool(self._available.value)
        if available != self._person.available:
            await self._api.people.set_availability(self._person.name, Availability(available=available))


def _arrows(effect: str) -> list[tuple[str, str | tuple[float, float]]]:
    """Arrows from things to the places where they should be."""
    relations = [part for part in conjuncts(parse(effect)) if isinstance(part, Relation)]
    pairs = [relation.arguments for relation in relations if len(relation.arguments) == 2]
    return [(first.name, second.name) for first, second in pairs if isinstance(first, Name) and isinstance(second, Name)]


class _AssignmentCard:
    """One assignment: what to do, and the replies that fit its state."""

    def __init__(self, api: LiveApi, assignment: Assignment) -> None:
        self._api, self._assignment = api, assignment
        work = assignment.work
        definition = api.context.ontology.services.get(work.service_type)
        self._values: dict[str, ui.input] = {}
        with (
            ui.element("section")
            .classes("somrs-question somrs-person-work")
            .props(f'aria-label="Assignment {assignment.number}"') as self.element
        ):
            with ui.element("div").classes("somrs-question-head"):
                ui.icon("undo" if work.undoes else "assignment").props('aria-hidden="true"')
                ui.label(f"Undo {work.service_type}" if work.undoes else work.service_type).props('role="heading" aria-level="2"')
                self._age = ui.label().classes("somrs-soft")
            if definition is not None and definition.doc and not work.undoes:
                ui.label(definition.doc + ".")
            with ui.element("dl").classes("somrs-person-facts"):
                for name, value in work.inputs.items():
                    _fact(name, self._named(value))
                _fact("In the end", work.effect)
            for name in work.open_variables:
                self._values[name] = ui.input(f"{name} (what you found)").props("outlined dense")
            self._replies = RebuiltElement().classes("somrs-person-replies")
            with ui.element("div").classes("somrs-person-trouble") as self._trouble:
                self._reason = ui.input("Why not?").props("outlined dense")
                self._left = ui.input("What is so now? (formula, if you know)").props("outlined dense").classes("somrs-formula")
                with ui.element("div").classes("somrs-question-ways"):
                    ui.button("Send", on_click=guarded(self._could_not)).props("unelevated no-caps color=primary")
                    ui.button("Back", on_click=lambda: self._open_trouble(False)).props("flat no-caps")
        self._trouble.visible = False
        self.show(assignment)

    def _named(self, value: str) -> str:
        """The object's name with its colour and label, by which a person can tell it."""
        object = self._api.context.map.objects.get(value)
        if object is None:
            return value
        features = [str(object.values[name]).lower() for name in ("Color",) if name in object.values]
        label = object.values.get("Label")
        return f"{value} ({', '.join([*([str(label)] if label else []), ' '.join([*features, object.type])])})"

    def show(self, assignment: Assignment) -> None:
        self._assignment = assignment
        self._replies.show(assignment.accepted is not None, self._build_replies)
        self.tick()

    def tick(self) -> None:
        assignment = self._assignment
        since = assignment.accepted or assignment.asked
        age = format_duration(max(0.0, time.time() - since))
        self._age.set_text(f"{'accepted' if assignment.accepted else 'asked'} {age} ago")

    def _build_replies(self) -> None:
        def button(label: str, action: Callable[[], object], *, main: bool = False) -> None:
            ui.button(label, on_click=action).props("unelevated no-caps color=primary size=lg" if main else "flat no-caps")

        if self._assignment.accepted is None:
            button("Accept", guarded(partial(self._send, Reply(kind=ReplyKind.ACCEPT))), main=True)
            button("Not now", guarded(partial(self._send, Reply(kind=ReplyKind.NOT_NOW))))
            button("Decline", guarded(partial(self._send, Reply(kind=ReplyKind.DECLINE))))
        else:
            button("Done", guarded(self._done), main=True)
            button("I could not", lambda: self._open_trouble(True))

    def _open_trouble(self, is_open: bool) -> None:
        self._trouble.visible = is_open
        if is_open:
            self._reason.run_method("focus")

    async def _done(self) -> None:
        await self._send(Reply(kind=ReplyKind.DONE, values={name: str(field.value or "") for name, field in self._values.items()}))

    async def _could_not(self) -> None:
        situation = str(self._left.value or "").strip() or None
        await self._send(Reply(kind=ReplyKind.COULD_NOT, reason=str(self._reason.value or "").strip(), situation=situation))

    async def _send(self, reply: Reply) -> None:
        window = ui.context.client
        await self._api.people.reply(self._assignment.number, reply)
        with window:  # the assignment may be closed and this card removed by now
            notify("Thank you." if reply.kind is ReplyKind.DONE else "Sent.")


def _fact(name: str, value: str) -> None:
    with ui.element("dt"):
        ui.label(name)
    with ui.element("dd"):
        ui.label(value)
