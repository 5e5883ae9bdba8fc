"""What the query of a formula shares with those of its quantifiers. The queries themselves are in `truth.py`."""

from __future__ import annotations

from typing import NamedTuple

from somrs.entish.formula import (
    And,
    Attribute,
    Call,
    Exists,
    ForAll,
    Formula,
    Not,
    Or,
    Relation,
    Term,
    Variable,
    conjuncts,
    terms,
    variables,
)
from somrs.entish.normal_form import affirmed_variables, negation
from somrs.ontology.map import Map
from somrs.ontology.types import ROOT, Ontology
from somrs.ontology.work_budget import WorkBudget


class Analysis(NamedTuple):
    """What a query needs to know of a formula: its variables' types, which of them stand for objects, which are open, and how many
    variables and parts it has, which is the work to begin with it."""

    types: dict[str, str | None]
    objects: set[str]
    affirmed: frozenset[str]
    size: int


class QueryContext:
    """The map, what has been looked up on it, and the work that the queries may still take together."""

    def __init__(self, map: Map, ontology: Ontology, budget: WorkBudget, formula: Formula) -> None:
        self.map, self.ontology, self.budget, self.formula = map, ontology, budget, formula
        self._analyses: dict[Formula, Analysis] = {}
        self._domains: dict[str | None, list[str]] = {}
        self._fits: dict[tuple[str, str], bool] = {}
        self._counterexamples: dict[tuple[ForAll, frozenset[str]], Formula] = {}

    def spend(self, steps: int = 1) -> None:
        self.budget.spend(self.formula, steps)

    def analysis(self, formula: Formula) -> Analysis:
        """What a query needs to know of the formula."""
        if formula not in self._analyses:
            types = {name: variable.type for name, variable in variables(formula).items()}
            size = len(types) + len(conjuncts(formula))
            affirmed = frozenset(affirmed_variables(formula))
            self._analyses[formula] = Analysis(types, object_variables(formula, self.ontology), affirmed, size)
        return self._analyses[formula]

    def is_subtype(self, type_name: str, ancestor: str) -> bool:
        key = type_name, ancestor
        if key not in self._fits:
            self._fits[key] = self.ontology.is_subtype(type_name, ancestor)
        return self._fits[key]

    def objects_of(self, type_name: str | None) -> list[str]:
        """The names of the objects of the type; of all objects, for None."""
        if type_name not in self._domains:
            if type_name is None or type_name == ROOT:
                names = list(self.map.objects)
            else:
                names = [name for t in self.ontology.subtypes(type_name) for name in self.map.of_type(t)]
            self._domains[type_name] = names
        return self._domains[type_name]

    def counterexample(self, quantified: ForAll, bound: dict[str, Term]) -> Formula:
        """What would have to hold for an object that contradicts the quantified formula."""
        key = quantified, frozenset(bound)
        if key not in self._counterexamples:
            self._counterexamples[key] = negation(quantified.body, {*bound, quantified.variable.name})
        return self._counterexamples[key]


def object_variables(formula: Formula, ontology: Ontology) -> set[str]:
    """The variables that stand for objects; the others stand for values."""
    match formula:
        case And(parts) | Or(parts):
            return {name for part in parts for name in object_variables(part, ontology)}
        case ForAll(variable, body) | Exists(variable, body):
            return object_variables(body, ontology) - {variable.name}
        case Not(atom):
            return object_variables(atom, ontology)
        case Relation():
            return set(variables(formula))
    variable_names: set[str] = set()
    for term in terms(formula):
        match term:
            case Attribute(Variable(name), _):
                variable_names.add(name)
            case Call():
                variable_names.update(variables(term))
            case Variable(name, type_name) if type_name is not None and (type_name == ROOT or type_name in ontology.types):
                variable_names.add(name)
    return variable_names
