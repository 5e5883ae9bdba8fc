"""The page of a person who does steps of tasks, for a phone: what to do and where, and the replies. It is found by a link or a code."""

from __future__ import annotations

from nicegui import ui

from somrs.api.people import Availability, People, PersonView
from somrs.api.remote import LiveApi
from somrs.client.hub import News
from somrs.devices.person.assignments import Assignment
from somrs.devices.person.questions import Question
from somrs.devices.person.wording import title
from somrs.entish.formula import Name, Relation, conjuncts
from somrs.entish.parse import parse
from somrs.errors import SomrsError
from somrs.gui.components.alert import Alert
from somrs.gui.components.fields.shown_at_once import shown_at_once
from somrs.gui.components.floorplan import FloorPlan
from somrs.gui.news import follow
from somrs.gui.pages.person.assignment_card import AssignmentCard
from somrs.gui.question_panel import QuestionPanel
from somrs.gui.shell import guarded, page, page_at

PATH = "/person"


def register(api: LiveApi) -> None:
    @page_at(PATH)
    async def show_entrance() -> None:
        with page("Your page", PATH, api, navigation=False):
            _Entrance(api)

    @page_at(PATH + "/{code}")
    async def show_page(code: str) -> None:
        with page("Your page", PATH, api, navigation=False):
            person = _find(await api.people.list(), code)
            if person is None:
                _Entrance(api, f"There is no page with the code {code}.")
            else:
                _PersonPage(api, person)


def _find(people: People, code: str) -> PersonView | None:
    return next((person for person in people.people if _plain(person.code) == _plain(code) != ""), None)


def _plain(code: str | None) -> str:
    """The code without what people write between its characters."""
    return "".join(character for character in (code or "") if character.isalnum()).upper()


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
        ui.navigate.to(f"{PATH}/{_plain(code)}")


class _PersonPage:
    """The page's content, updated in place: a reply that is being written stays while other assignments come and go."""

    def __init__(self, api: LiveApi, person: PersonView) -> None:
        self._api, self._person = api, person
        self._cards: dict[int, AssignmentCard] = {}
        self._questions: list[Question] = []
        self._known_requests: set[str] | None = None
        self._shown: tuple[str, ...] | None = None
        with ui.element("div").classes("somrs-person"):
            with ui.element("header").classes("somrs-person-head"):
                ui.label(person.label or person.name).classes("somrs-title").props('role="heading" aria-level="1"')
                self._available = shown_at_once(ui.switch("Available", on_change=guarded(self._set_available)))
            with ui.element("div").classes("somrs-person-head"):
                self._status = ui.label().classes("somrs-soft").props('role="status"')
                self._alert = Alert()
            with ui.element("section").classes("somrs-question").props('aria-label="Missed"') as self._missed:
                self._missed_text = ui.label()
                with ui.element("div").classes("somrs-person-replies"):
                    ui.button("I am available again", on_click=guarded(self._return)).props("unelevated no-caps color=primary size=lg")
            QuestionPanel(api, person=person.name, on_change=self._show_questions)
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
                    self._cards[number] = AssignmentCard(self._api, assignment)
                else:
                    card.show(assignment)
        self._missed.visible = person.missed is not None
        if person.missed is not None:
            self._missed_text.set_text(f"You did not answer in time: {_summary(person.missed)}. So nobody asks you to do anything.")
        self._show_status()
        self._mark(person.assignments)

    def _show_questions(self, questions: list[Question]) -> None:
        self._questions = questions
        self._show_status()

    def _show_status(self) -> None:
        count = len(self._person.assignments) + len(self._questions)
        if count:
            text = f"{count} thing{'s' if count != 1 else ''} to do"
        elif self._person.available:
            text = "There is nothing to do. New requests appear here by themselves."
        else:
            text = "You are not available: nobody asks you to do anything."
        self._status.set_text(text)
        ui.page_title(f"({count}) Your page · SO-MRS" if count else "Your page · SO-MRS")
        self._alert_of_news()

    def _alert_of_news(self) -> None:
        """Alert the person of requests that were not there before."""
        requests = {f"assignment {assignment.number}": _summary(assignment) for assignment in self._person.assignments}
        requests |= {f"question {question.number}": question.text for question in self._questions}
        if self._known_requests is not None:
            for text in [text for key, text in requests.items() if key not in self._known_requests][:1]:
                self._alert.announce(text)
        self._known_requests = {*requests}

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

    async def _return(self) -> None:
        await self._api.people.set_availability(self._person.name, Availability(available=True))

    async def _set_available(self) -> None:
        available = bool(self._available.value)
        if available == self._person.available:
            return
        try:
            await self._api.people.set_availability(self._person.name, Availability(available=available))
        except SomrsError:
            self._available.set_value(self._person.available)
            raise


def _summary(assignment: Assignment) -> str:
    """One line about an assignment."""
    work = assignment.work
    action = "stop" if work.stops else "undo" if work.undoes else ""
    return f"{' '.join(filter(None, (action, title(work.service_type))))}: {work.aim or work.effect}"


def _arrows(effect: str) -> list[tuple[str, str | tuple[float, float]]]:
    """Arrows from things to the places where they should be."""
    relations = [part for part in conjuncts(parse(effect)) if isinstance(part, Relation)]
    pairs = [relation.arguments for relation in relations if len(relation.arguments) == 2]
    return [(first.name, second.name) for first, second in pairs if isinstance(first, Name) and isinstance(second, Name)]
