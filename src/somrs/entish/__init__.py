"""Entish: the quantifier-free formula language of tasks, preconditions, effects and situations."""

from somrs.entish.formula import (
    And,
    Arithmetic,
    Attribute,
    Call,
    Comparison,
    Formula,
    Name,
    Not,
    Number,
    Or,
    Relation,
    Term,
    Text,
    Truth,
    Variable,
)

__all__ = [
    "And",
    "Arithmetic",
    "Attribute",
    "Call",
    "Comparison",
    "Formula",
    "Name",
    "Not",
    "Number",
    "Or",
    "Relation",
    "Term",
    "Text",
    "Truth",
    "Variable",
]
