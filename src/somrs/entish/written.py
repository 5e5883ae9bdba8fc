"""The tree of a formula as it is written, and the formula that it means: which variable is which, and where each NOT goes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from msgspec import Struct

from somrs.entish.formula import (
    Atom,
    Exists,
    ForAll,
    Formula,
    Not,
    Term,
    Variable,
    conjunction,
    disjunction,
    substitute,
    substitute_term,
    variables,
)
from somrs.entish.normal_form import distribute_for_all


class WrittenType(Struct, frozen=True):
    """The type that is written after a variable, and its offset in the text."""

    variable: str
    type: str
    place: int


class WrittenAtom(Struct, frozen=True):
    """`places` are the offsets of the relation or comparison sign (None) and of the terms; `types` the types written in it."""

    atom: Atom
    places: tuple[tuple[Term | None, int], ...]
    types: tuple[WrittenType, ...]


class WrittenJunction(Struct, frozen=True):
    """Parts joined by AND, or by OR."""

    is_conjunction: bool
    parts: tuple[Written, ...]


class WrittenNot(Struct, frozen=True):
    part: Written


class WrittenQuantifier(Struct, frozen=True):
    """FORALL (`is_universal`) or EXISTS."""

    is_universal: bool
    variable: str
    type: WrittenType | None
    body: Written


Written = WrittenAtom | WrittenJunction | WrittenNot | WrittenQuantifier


class TwoTypes(Exception):
    """A variable with two types; `second` is the type that does not fit."""

    def __init__(self, first: WrittenType, second: WrittenType) -> None:
        self.first, self.second = first, second


class Meaning:
    """The formula that a written tree means, with the offsets of its atoms' terms and of its variables' types. Raises TwoTypes."""

    def __init__(self, written: Written) -> None:
        self.places: dict[tuple[Atom, Term | None], int] = {}
        self.types: dict[Variable, int] = {}
        self.formula = self._formula(written, self._typed(_types(written)), False, frozenset(_affirmed(written)))

    def _typed(self, types: Mapping[str, WrittenType]) -> dict[str, Variable]:
        """The variables with their types. A type that is written at one occurrence of a variable holds for all its occurrences."""
        typed = {name: Variable(name, written.type) for name, written in types.items()}
        for name, written in types.items():
            self.types.setdefault(typed[name], written.place)
        return typed

    def _formula(self, written: Written, typed: Mapping[str, Variable], negated: bool, bound: frozenset[str]) -> Formula:
        """The formula in negation normal form. `negated`: under an odd number of NOTs; `bound`: variables that belong to a scope around."""
        match written:
            case WrittenAtom():
                atom = self._atom(written, typed)
                return Not(atom) if negated else atom
            case WrittenJunction(is_conjunction, parts):
                formulas = [self._formula(part, typed, negated, bound) for part in parts]
                return conjunction(*formulas) if is_conjunction is not negated else disjunction(*formulas)
            case WrittenQuantifier(is_universal, name, _, body):
                own = {name: Variable(name), **self._typed(_of_variable(name, _scope_types(written)))}
                formula = self._formula(body, {**typed, **own}, negated, bound | {name})
                return (ForAll if is_universal is not negated else Exists)(own[name], formula)
            case WrittenNot(part):
                local = [typed.get(name, Variable(name)) for name in _affirmed(part) if name not in bound]
                formula = self._formula(part, typed, not negated, bound.union(variable.name for variable in local))
                if not negated:
                    return distribute_for_all(local, formula)
                for variable in reversed(local):
                    formula = Exists(variable, formula)
                return formula

    def _atom(self, written: WrittenAtom, typed: Mapping[str, Variable]) -> Atom:
        atom = substitute(written.atom, typed)
        assert isinstance(atom, Atom), "a variable was given its type"
        for term, place in written.places:
            self.places.setdefault((atom, substitute_term(term, typed) if term is not None else None), place)
        return atom


def _types(written: Written) -> dict[str, WrittenType]:
    """The types of the variables that no quantifier in it binds."""
    match written:
        case WrittenAtom():
            return _merge([written.types])
        case WrittenJunction(_, parts):
            return _merge(_types(part).values() for part in parts)
        case WrittenNot(part):
            return _types(part)
        case WrittenQuantifier(_, name, _, _):
            return {other: written_type for other, written_type in _scope_types(written).items() if other != name}


def _scope_types(quantifier: WrittenQuantifier) -> dict[str, WrittenType]:
    """The types of the variables within a quantifier, its own included."""
    return _merge([[quantifier.type] if quantifier.type is not None else [], _types(quantifier.body).values()])


def _of_variable(name: str, types: Mapping[str, WrittenType]) -> dict[str, WrittenType]:
    return {name: types[name]} if name in types else {}


def _merge(groups: Iterable[Iterable[WrittenType]]) -> dict[str, WrittenType]:
    merged: dict[str, WrittenType] = {}
    for written in (written for group in groups for written in group):
        first = merged.setdefault(written.variable, written)
        if first.type != written.type:
            raise TwoTypes(first, written)
    return merged


def _affirmed(written: Written) -> dict[str, None]:
    """The variables outside NOT that no quantifier in it binds, in written order."""
    match written:
        case WrittenAtom(atom):
            return dict.fromkeys(variables(atom))
        case WrittenJunction(_, parts):
            return {name: None for part in parts for name in _affirmed(part)}
        case WrittenNot():
            return {}
        case WrittenQuantifier(_, variable, _, body):
            return {name: None for name in _affirmed(body) if name != variable}
