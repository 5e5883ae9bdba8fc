"""What a person has found out: which things are somewhere, where a thing is, or the values that the work leaves open."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from msgspec import Struct
from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.devices.person.answers import unknown_objects
from somrs.devices.person.assignments import Reply, ReplyKind, Work
from somrs.devices.person.wording import words
from somrs.entish.formula import Name, Relation, Variable, conjuncts, substitute
from somrs.entish.parse import parse
from somrs.errors import UsageError
from somrs.gui.components.fields.picker import Choice, Picker, things
from somrs.gui.places import PlacePicker
from somrs.ontology.services import ServiceKind, ServiceType

NEW = "seen"
"""The name of the variables for things that the map does not have, with a number."""


class _Sighting(Struct):
    """A thing that was seen: an object of the map, or a new one of a type and perhaps a colour."""

    known: str = ""
    type: str = ""
    color: str = ""


class FindingForm:
    """The fields for what the work is to find out; there may be none."""

    def __init__(self, api: LiveApi, work: Work) -> None:
        self._api, self._work, self._effect = api, work, parse(work.effect)
        self._places: dict[str, str] = {}
        self._values: dict[str, ui.input] = {}
        self._sightings: list[_Sighting] = []
        self._seen_type = _seen_type(work, api.context.ontology.services.get(work.service_type), api)
        for name in unknown_objects(self._effect):
            ui.label(f"Where is {name}?").classes("somrs-person-ask")
            PlacePicker(name, api.context.map, api.context.ontology, partial(self._places.__setitem__, name))
        if self._seen_type is not None:
            self._build_sightings()
            return
        for name in work.open_variables:
            self._values[name] = ui.input(f"{words(name).capitalize()} (what you found)").props("outlined dense")

    @property
    def is_needed(self) -> bool:
        """Whether the work finds something out."""
        return bool(self._seen_type is not None or self._values or unknown_objects(self._effect))

    def reply(self) -> Reply:
        """The reply that the work is done. Raises UsageError if something is missing."""
        for name in unknown_objects(self._effect):
            if name not in self._places:
                raise UsageError(f"Choose where {name} is, or say that you could not find it.")
        if self._seen_type is not None:
            parts = [self._sighted(number, sighting) for number, sighting in enumerate(self._sightings)]
            return Reply(kind=ReplyKind.DONE, situation=" AND ".join(parts) or None, searched=self._searched)
        if self._places:
            return Reply(kind=ReplyKind.DONE, situation=" AND ".join(self._places.values()))
        return Reply(kind=ReplyKind.DONE, values={name: str(field.value or "") for name, field in self._values.items()})

    # Things that are somewhere

    def _build_sightings(self) -> None:
        assert self._seen_type is not None
        ui.label("What do you see there?").classes("somrs-person-ask")
        self._rows = ui.element("ul").classes("somrs-person-seen")
        self._known = ui.element("div")
        ontology = self._api.context.ontology
        subtypes = sorted({*ontology.subtypes(self._seen_type)} - {self._seen_type}) or [self._seen_type]
        types = [Choice(value=name, text=words(name)) for name in subtypes]
        colors = ontology.attributes["Color"].values if "Color" in ontology.attributes else ()
        with ui.element("div").classes("somrs-person-new"):
            self._type = Picker("Type of a new thing", placeholder="New: what is it?", options=types)
            self._color = Picker("Colour of a new thing", placeholder="Colour", options=[Choice(value=str(color)) for color in colors])
            ui.button("Add", on_click=self._add_new).props("flat no-caps")
        self._show_sightings()

    def _add_known(self, name: str) -> None:
        if name and all(sighting.known != name for sighting in self._sightings):
            self._sightings.append(_Sighting(known=name))
        self._show_sightings()

    def _add_new(self) -> None:
        if self._type.value:
            self._sightings.append(_Sighting(type=self._type.value, color=self._color.value))
            self._type.choose("")
            self._color.choose("")
        self._show_sightings()

    def _remove(self, sighting: _Sighting) -> None:
        self._sightings.remove(sighting)
        self._show_sightings()

    def _show_sightings(self) -> None:
        """Show what was seen so far, and empty the field for more."""
        self._known.clear()
        with self._known:
            label, hint, known = "Add a thing that you see", "Add one that is known", things(type=self._seen_type)
            Picker(label, placeholder=hint, source=known, on_pick=self._add_known)
        self._rows.clear()
        with self._rows:
            for sighting in self._sightings:
                text = sighting.known or f"new: {sighting.color.lower()} {words(sighting.type)}"
                with ui.element("li"):
                    ui.label(text)
                    ui.button(icon="close", on_click=partial(self._remove, sighting)).props(f'flat round dense aria-label="Remove {text}"')
            if not self._sightings:
                with ui.element("li").classes("somrs-soft"):
                    ui.label("Nothing so far. “Done” then says that nothing is there.")

    def _sighted(self, number: int, sighting: _Sighting) -> str:
        """The effect with the thing in place of its variable."""
        variable = f"{NEW}{number}"
        seen = Name(sighting.known) if sighting.known else Variable(variable, sighting.type)
        text = str(substitute(self._effect, {self._work.open_variables[0]: seen}))
        return f"{text} AND ?{variable}.Color = {sighting.color}" if sighting.color else text

    @property
    def _searched(self) -> tuple[str, ...]:
        """The places that the person has seen whole."""
        relations = [part for part in conjuncts(self._effect) if isinstance(part, Relation) and len(part.arguments) == 2]
        places = [part.arguments[1] for part in relations if isinstance(part.arguments[0], Variable)]
        return tuple(dict.fromkeys(place.name for place in places if isinstance(place, Name)))


def _seen_type(work: Work, service_type: ServiceType | None, api: LiveApi) -> str | None:
    """The type of the things that the work is to find, if it asks which things are somewhere."""
    if service_type is None or service_type.kind is not ServiceKind.COGNITIVE or len(work.open_variables) != 1:
        return None
    types: Mapping[str, str] = {output.name: output.type for output in service_type.outputs}
    type = types.get(work.open_variables[0])
    return type if type is not None and type in api.context.ontology.types else None
