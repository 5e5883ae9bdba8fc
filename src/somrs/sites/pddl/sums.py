"""Arithmetic: PDDL expressions as sums of products, because Entish has no parentheses in terms."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

from somrs.entish import Arithmetic, Attribute, Call, Number, Term
from somrs.entish.formula import Substitution, substitute_term

Factor = Attribute | Call


@dataclass(frozen=True, slots=True)
class Sum:
    """A sum of products: each part has factors and a coefficient."""

    parts: tuple[tuple[tuple[Factor, ...], float], ...]

    def __add__(self, addend: Sum) -> Sum:
        return _sum([*self.parts, *addend.parts])

    def __mul__(self, multiplier: Sum) -> Sum:
        return _sum(
            [((*left_factors, *right_factors), m * n) for (left_factors, m), (right_factors, n) in product(self.parts, multiplier.parts)]
        )

    def times(self, number: float) -> Sum:
        return _sum([(factors, count * number) for factors, count in self.parts])

    @property
    def number(self) -> float | None:
        """The value of a constant sum; None if it has factors."""
        if any(factors for factors, _ in self.parts):
            return None
        return sum(count for _, count in self.parts)

    @property
    def term(self) -> Term:
        """The sum as an Entish term."""
        term: Term | None = None
        for factors, count in self.parts:
            magnitude = _product(factors, abs(count))
            term = _product(factors, count) if term is None else Arithmetic(term, "+" if count > 0 else "-", magnitude)
        return term if term is not None else Number(0)

    def substituted(self, bindings: Substitution) -> Sum:
        parts: list[tuple[tuple[Factor, ...], float]] = []
        for factors, count in self.parts:
            replaced = tuple(substitute_term(factor, bindings) for factor in factors)
            parts.append((tuple(factor for factor in replaced if isinstance(factor, Attribute | Call)), count))
        return _sum(parts)


def constant(value: float) -> Sum:
    return _sum([((), value)])


def single_factor(factor: Factor) -> Sum:
    return _sum([((factor,), 1.0)])


def _sum(parts: list[tuple[tuple[Factor, ...], float]]) -> Sum:
    """The sum with equal products combined, and without those that cancel out."""
    counts: dict[tuple[Factor, ...], float] = {}
    for factors, count in parts:
        key = tuple(sorted(factors, key=str))
        counts[key] = counts.get(key, 0.0) + count
    return Sum(tuple((factors, count) for factors, count in counts.items() if count))


def _product(factors: tuple[Factor, ...], count: float) -> Term:
    term: Term | None = Number(count) if count != 1 or not factors else None
    for factor in factors:
        term = Arithmetic(term, "*", factor) if term is not None else factor
    assert term is not None
    return term
