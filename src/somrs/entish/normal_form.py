"""Negation normal form: where NOT goes when it is moved inwards, and which variables a formula leaves open.

A variable without a quantifier belongs to the whole formula if it occurs outside NOT. Otherwise it belongs to the outermost NOT in which it
occurs outside a further NOT, and stands for any object there: `NOT (?x isOn T AND ?x.Color = Red)` says that no such object is so.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping

from somrs.entish.formula import And, Exists, ForAll, Formula, Not, Or, Quantified, Variable, conjunction, disjunction, variables


def has_quantifiers(formula: Formula) -> bool:
    match formula:
        case And(parts) | Or(parts):
            return any(map(has_quantifiers, parts))
        case _:
            return isinstance(formula, Quantified)


def negation(formula: Formula, bound: Collection[str] = ()) -> Formula:
    """The negation in negation normal form. `bound`: the variables that have a value. Another variable after a NOT stands for any object;
    where that NOT goes, the variable gets an EXISTS."""
    match formula:
        case And(parts):
            return disjunction(*(negation(part, bound) for part in parts))
        case Or(parts):
            return conjunction(*(negation(part, bound) for part in parts))
        case ForAll(variable, body):
            return Exists(variable, negation(body, {*bound, variable.name}))
        case Exists(variable, body):
            return ForAll(variable, negation(body, {*bound, variable.name}))
        case Not(atom):
            positive: Formula = atom
            for name, variable in variables(atom).items():
                positive = positive if name in bound else Exists(variable, positive)
            return positive
        case _:
            return Not(formula)


def affirmed_variables(formula: Formula) -> Mapping[str, Variable]:
    """The variables that the formula leaves open: those that no quantifier binds and that occur outside NOT, in written order."""
    match formula:
        case And(parts) | Or(parts):
            return {name: variable for part in parts for name, variable in affirmed_variables(part).items()}
        case ForAll(bound_variable, body) | Exists(bound_variable, body):
            return {name: variable for name, variable in affirmed_variables(body).items() if name != bound_variable.name}
        case Not():
            return {}
        case _:
            return variables(formula)


def distribute_for_all(quantified: Collection[Variable], formula: Formula) -> Formula:
    """FORALL for each of the variables before the formula, moved inwards as far as they go. A negated atom says it without a quantifier.
    The variables must not have values from elsewhere."""
    own = [variable for variable in quantified if variable.name in variables(formula)]
    match formula:
        case Not():
            return formula
        case _ if not own:
            return formula
        case And(parts):
            return conjunction(*(distribute_for_all(own, part) for part in parts))
        case Or(parts):
            groups = group_by_variables(parts, {variable.name for variable in own})
            if len(groups) > 1:
                return disjunction(*(distribute_for_all(own, disjunction(*group)) for group in groups))
    for variable in reversed(own):
        formula = ForAll(variable, formula)
    return formula


def group_by_variables(parts: Iterable[Formula], names: Collection[str]) -> list[list[Formula]]:
    """The parts in groups that share none of the named variables."""
    groups: list[tuple[set[str], list[Formula]]] = []
    for part in parts:
        shared, group = {name for name in variables(part) if name in names}, [part]
        for other in [other for other in groups if not shared.isdisjoint(other[0])]:
            groups.remove(other)
            shared, group = shared | other[0], other[1] + group
        groups.append((shared, group))
    return [group for _, group in groups]
