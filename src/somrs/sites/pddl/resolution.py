"""Resolves the conditions of effects that facts decide which no action changes: whether a plane is at an airport on a day.

The action gets a case for each choice of the objects on which these conditions depend. In each case, the conditions hold or fail.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from somrs.entish import And, Comparison, Formula, Name, Not, Or, Relation, Variable
from somrs.entish.formula import conjuncts, substitute, variables
from somrs.ontology.map import Map
from somrs.sites.pddl.effects import Effects
from somrs.sites.pddl.formulas import SymbolTable
from somrs.sites.pddl.kinds import Sorts

MOST_CHOICES = 1_000
"""The maximum number of choices of objects for one action, each of which becomes a service type."""

Choice = Mapping[str, Name]
"""Objects for some variables of an action."""


class TooManyChoices(Exception):
    """There are more than `MOST_CHOICES`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Variant:
    """An action with the objects of one choice; without a choice, as it is."""

    choice: Choice
    precondition: tuple[Formula, ...]
    effects: Effects


def resolve(
    precondition: Formula | None, effects: Effects, scope: Mapping[str, Sorts], symbols: SymbolTable, map: Map
) -> Iterator[Variant]:
    """The variants of an action whose effects have only conditions that actions can change. `scope`: its variables, with their possible
    types. Raises TooManyChoices."""
    parts = conjuncts(precondition) if precondition is not None else ()
    deciding = {name: sorts for name, sorts in scope.items() if name in _deciding_variables(effects, symbols)}
    chosen: dict[tuple[Name, ...], Choice] = {}
    for choice in _Choices(parts, deciding, symbols, map).extend({}):
        chosen.setdefault(tuple(choice.values()), choice)
        if len(chosen) > MOST_CHOICES:
            raise TooManyChoices
    for choice in chosen.values():
        settled = [symbols.settle(substitute(part, choice)) for part in parts]
        resolved_effects = effects.resolved(choice, symbols.settle)
        if resolved_effects is not None and not any(part is False for part in settled):
            open_parts = tuple(part for part in settled if not isinstance(part, bool))
            yield Variant(choice=choice, precondition=open_parts, effects=resolved_effects)


def _deciding_variables(effects: Effects, symbols: SymbolTable) -> set[str]:
    """The variables of the parts of conditions about which no action decides."""
    names: set[str] = set()
    for conditional in effects.conditional:
        names.update(name for atom in _unchanging(conditional.holds, symbols) for name in variables(atom))
        names |= _deciding_variables(conditional.effects, symbols)
    return names


def _unchanging(formula: Formula, symbols: SymbolTable) -> Iterator[Formula]:
    match formula:
        case Relation(name) if name not in symbols.changing:
            yield formula
        case Comparison(Name() | Variable(), "=" | "!=", Name() | Variable()):
            yield formula
        case Not(part):
            yield from _unchanging(part, symbols)
        case And(parts) | Or(parts):
            for branch in parts:
                yield from _unchanging(branch, symbols)


class _Choices:
    """The choices for the deciding variables that the precondition admits, as far as facts decide which no action changes."""

    def __init__(self, parts: Sequence[Formula], deciding: Mapping[str, Sorts], symbols: SymbolTable, map: Map) -> None:
        self.deciding, self.symbols, self.map = deciding, symbols, map
        self.relations = [
            part
            for part in parts
            if isinstance(part, Relation) and part.relation not in symbols.changing and not deciding.keys().isdisjoint(variables(part))
        ]
        self.comparisons = [part for part in parts if isinstance(part, Comparison)]

    def extend(self, choice: dict[str, Name]) -> Iterator[Choice]:
        """The choices that agree with this one, by the relation with the most variables chosen."""
        if any(self.symbols.settle(substitute(comparison, choice)) is False for comparison in self.comparisons):
            return
        open_relations = [part for part in self.relations if not self._chosen(part, choice)]
        if open_relations:
            relation = min(open_relations, key=lambda part: sum(name not in choice for name in variables(part)))
            for fact in self.map.facts(relation.relation):
                if (matched := self._match(relation, fact.arguments, choice)) is not None:
                    yield from self.extend(matched)
            return
        name = next((name for name in self.deciding if name not in choice), None)
        if name is None:
            yield {name: choice[name] for name in self.deciding}
            return
        for object, sort in self.symbols.types.items():
            if sort in self.deciding[name]:
                yield from self.extend({**choice, name: Name(self.symbols.objects.entish(object))})

    def _chosen(self, relation: Relation, choice: Choice) -> bool:
        """Whether nothing of the relation is left to choose."""
        return all(name in choice for name in variables(relation) if name in self.deciding)

    def _match(self, relation: Relation, arguments: Sequence[str], choice: Choice) -> dict[str, Name] | None:
        """The choice that the fact extends; None if it contradicts the choice. What is not to be chosen may be anything."""
        matched = dict(choice)
        for term, argument in zip(relation.arguments, arguments, strict=True):
            if isinstance(term, Name):
                if term.name != argument:
                    return None
            elif term.name in self.deciding:
                sort = self.symbols.types[self.symbols.objects.pddl(argument)]
                if sort not in self.deciding[term.name] or matched.setdefault(term.name, Name(argument)).name != argument:
                    return None
        return matched
