"""The rules for the objects of a type, and of which values their formulas speak. `conformance.py` checks objects by them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

from somrs.entish import Name
from somrs.entish.formula import Attribute, Call, Comparison, Not, literals, terms, variables
from somrs.entish.normal_form import has_quantifiers
from somrs.entish.parse import parse
from somrs.ontology.complex_values import inner_constraints
from somrs.ontology.types import AttributeType, Constraint, ObjectType, Ontology, Value

SELF_VARIABLE = "Self"
"""In the formulas of a type's constraints, `?Self` is the object of that type."""


@lru_cache(maxsize=1024)
def is_about_itself(text: str) -> bool:
    """Whether a constraint's formula only has the object's own values in it."""
    formula = parse(text)
    atoms = (literal.atom if isinstance(literal, Not) else literal for literal in literals(formula))
    simple = not has_quantifiers(formula) and all(
        isinstance(atom, Comparison) and not any(isinstance(term, Call) for term in terms(atom)) for atom in atoms
    )
    has_named_objects = any(isinstance(term, Attribute) and isinstance(term.owner, Name) for term in terms(formula))
    return simple and not has_named_objects and set(variables(formula)) <= {SELF_VARIABLE}


@lru_cache(maxsize=1024)
def attribute_paths(text: str) -> tuple[str, ...]:
    """The attribute paths in a formula, each once."""
    return tuple(dict.fromkeys(term.path for term in terms(parse(text)) if isinstance(term, Attribute)))


class TypeRules:
    """The rules for the objects of a type, inherited ones included, computed once for all objects."""

    def __init__(self, ontology: Ontology, type_name: str) -> None:
        types: list[ObjectType] = [ontology.types[name] for name in ontology.ancestors(type_name)]
        self.attributes: Mapping[str, AttributeType] = ontology.attributes_of(type_name)
        self.required = tuple(dict.fromkeys(name for type in reversed(types) for name in type.required))
        self.parts = tuple(part for type in types for part in type.parts)
        of_attributes = ((type_name, c) for path, attribute in self.attributes.items() for c in inner_constraints(path, attribute))
        of_types = ((type.name, c) for type in reversed(types) for c in type.constraints)
        self.constraints: tuple[tuple[str, Constraint], ...] = (*of_attributes, *of_types)
        self.external_constraints = tuple(
            (owner, c) for owner, c in self.constraints if c.formula is not None and not is_about_itself(c.formula)
        )
        """The constraints that changes of other objects may break."""
        self.defaults: dict[str, Value] = {}
        for type in reversed(types):
            self.defaults.update(type.defaults)
        self.defaulted = {path.split(".")[0] for path in self.defaults}
