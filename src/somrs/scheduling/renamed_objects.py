"""Templates and standing orders whose objects have another name on the map now: they were renamed, or turned out to be other objects."""

from __future__ import annotations

import re
from collections.abc import Mapping

from msgspec import structs

from somrs.ontology.naming import Renaming, Section
from somrs.ontology.renaming import Renamer
from somrs.ontology.types import Ontology
from somrs.protocol.messages.orders import BLANK, Blank, StandingOrder, Template
from somrs.protocol.messages.submission import with_formulas
from somrs.scheduling.book import Book
from somrs.scheduling.templates import VALUES

STAND_IN = "in-place-of-blank-"
"""In place of the blanks of a formula stand variables of this name with a number, so that the formula can be parsed."""


class BookRenamer:
    """Gives objects their new names in templates and orders. `names`: the new names by the old ones.

    A formula with a blank where no variable can stand, such as in front of a unit, stays as it is: its order is refused when it is due.
    """

    def __init__(self, names: Mapping[str, str], ontology: Ontology) -> None:
        self._names = names
        self._renamer = Renamer((Renaming(section=Section.OBJECTS, name=name, to=to) for name, to in names.items()), ontology)

    def rename(self, book: Book) -> tuple[bool, bool]:
        """Rename the objects in the book. Returns whether templates changed, and whether orders did."""
        orders = {id: self._order(order, book.templates.get(order.template or "")) for id, order in book.orders.items()}
        templates = {name: self._template(template) for name, template in book.templates.items()}
        changes = templates != book.templates, orders != book.orders
        book.orders, book.templates = orders, templates
        return changes

    def _template(self, template: Template) -> Template:
        task = with_formulas(template.task, self._text)
        blanks = tuple(structs.replace(blank, default=self._value(blank, blank.default)) for blank in template.blanks)
        renamed = structs.replace(template, task=task, blanks=blanks)
        return structs.replace(renamed, version=template.version + 1) if renamed != template else template

    def _order(self, order: StandingOrder, template: Template | None) -> StandingOrder:
        task = with_formulas(order.task, self._text) if order.task is not None else None
        blanks = {blank.name: blank for blank in template.blanks} if template is not None else {}
        values = {name: self._value(blanks.get(name), value) for name, value in order.values.items()}
        renamed = structs.replace(order, task=task, values=values)
        return structs.replace(renamed, version=order.version + 1) if renamed != order else order

    def _value(self, blank: Blank | None, value: str) -> str:
        is_object = blank is not None and blank.type not in VALUES
        return self._names.get(value.strip(), value) if is_object else value

    def _text(self, formula: str) -> str:
        blanks = BLANK.findall(formula)
        numbers = iter(range(len(blanks)))
        readable = BLANK.sub(lambda _: f"?{STAND_IN}{next(numbers)}", formula)
        renamed = self._renamer.text(readable) or readable
        return re.sub(rf"\?{STAND_IN}(\d+)", lambda match: f"{{{blanks[int(match[1])]}}}", renamed)
