"""A reference implementation of PDDL by its definition: ground actions on sets of facts, where an add takes precedence over a delete."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from somrs.sites.pddl import syntax, text
from somrs.sites.pddl.text import Group, Node, Word

Fact = tuple[str, ...]
State = frozenset[Fact]


@dataclass(frozen=True)
class Ground:
    """An action with objects for its agent and its parameters."""

    action: syntax.Action
    arguments: tuple[str, ...]

    def __str__(self) -> str:
        return f"({' '.join([self.action.word.text, *self.arguments])})"

    @property
    def bound(self) -> Mapping[str, str]:
        things = (*([self.action.agent] if self.action.agent else []), *self.action.parameters)
        return {f"?{thing.name}": name for thing, name in zip(things, self.arguments, strict=True)}


class Naive:
    """A domain and a problem."""

    def __init__(self, domain: Path, problem: Path) -> None:
        roots = [text.parse(path.read_text(), text.Mistakes(path.name)) for path in (domain, problem)]
        assert roots[0] is not None
        assert roots[1] is not None
        self.domain = syntax.domain(roots[0], text.Mistakes("domain"))
        self.task = syntax.task(roots[1], text.Mistakes("problem"), self.domain)
        self.objects = {**self.domain.constants, **self.task.objects}
        self.initial: State = frozenset(self._stated(node) for node in self.task.init)

    @staticmethod
    def _stated(node: Node) -> Fact:
        """Return the fact of an initial statement. A number becomes a fact with `=`, the function and its value."""
        assert isinstance(node, Group)
        return _number_fact(_format_term(node.items[1], {}), float(str(node.items[2]))) if node.head == "=" else _fact(node, {})

    def _objects_of(self, types: tuple[str, ...]) -> list[str]:
        def is_subtype(name: str, ancestor: str) -> bool:
            return (
                name == ancestor
                or ancestor == syntax.OBJECT
                or any(is_subtype(parent, ancestor) for parent in self.domain.parents.get(name, ()))
            )

        return [
            name for name, thing in self.objects.items() if any(is_subtype(own, type_name) for own in thing.types for type_name in types)
        ]

    def actions(self) -> Iterator[Ground]:
        for action in self.domain.actions.values():
            things = (*([action.agent] if action.agent else []), *action.parameters)
            for arguments in itertools.product(*(self._objects_of(thing.types) for thing in things)):
                yield Ground(action, arguments)

    def applicable(self, ground: Ground, state: State) -> bool:
        return ground.action.precondition is None or self._is_satisfied(ground.action.precondition, ground.bound, state)

    def apply(self, ground: Ground, state: State) -> State:
        adds, deletes = set[Fact](), set[Fact]()
        numbers: dict[str, float] = {}
        for part, bound in self._effects(ground.action.effect, ground.bound, state):
            if part.head == "not":
                deletes.add(_fact(part.items[1], bound))
            elif part.head in ("increase", "decrease", "assign"):
                name, amount = _format_term(part.items[1], bound), self._number(part.items[2], bound, state)
                old_value = _value(name, state)
                deletes.add(_number_fact(name, old_value))
                sign = {"increase": 1, "decrease": -1}.get(part.head)
                numbers[name] = amount if sign is None else numbers.get(name, old_value) + sign * amount
            else:
                adds.add(_fact(part, bound))
        return (state - deletes) | adds | {_number_fact(name, value) for name, value in numbers.items()}

    def _effects(self, node: Node | None, bound: Mapping[str, str], state: State) -> Iterator[tuple[Group, Mapping[str, str]]]:
        """Return the effects that the action has in the state, each with its bindings."""
        assert isinstance(node, Group)
        match node.head:
            case "and":
                for part in node.items[1:]:
                    yield from self._effects(part, bound, state)
            case "forall":
                for extended in self._extensions(node, bound):
                    yield from self._effects(node.items[2], extended, state)
            case "when":
                if self._is_satisfied(node.items[1], bound, state):
                    yield from self._effects(node.items[2], bound, state)
            case _:
                yield node, bound

    def _extensions(self, node: Group, bound: Mapping[str, str]) -> Iterator[Mapping[str, str]]:
        """Return the bindings with each choice of objects for the variables of a quantifier."""
        assert isinstance(node.items[1], Group)
        things = [*syntax.typed_names(node.items[1].items, text.Mistakes("quantifier"))]
        for names in itertools.product(*(self._objects_of(thing.types) for thing in things)):
            yield {**bound, **{f"?{thing.name}": name for thing, name in zip(things, names, strict=True)}}

    def cost(self, ground: Ground, state: State) -> float:
        """Return the increase of the total cost."""
        return _value("(total-cost)", self.apply(ground, state)) - _value("(total-cost)", state)

    def reached(self, state: State) -> bool:
        assert self.task.goal is not None
        return self._is_satisfied(self.task.goal, {}, state)

    def _number(self, node: Node, bound: Mapping[str, str], state: State) -> float:
        if isinstance(node, Word):
            return float(node.text)
        if node.head in ("+", "-", "*", "/"):
            first, *operands = (self._number(item, bound, state) for item in node.items[1:])
            for operand in operands:
                first = {"+": first + operand, "-": first - operand, "*": first * operand, "/": first / (operand or 1)}[node.head]
            return first if operands or node.head != "-" else -first
        return _value(_format_term(node, bound), state)

    def _is_satisfied(self, node: Node, bound: Mapping[str, str], state: State) -> bool:
        assert isinstance(node, Group)
        rest = node.items[1:]
        match node.head:
            case "and":
                return all(self._is_satisfied(part, bound, state) for part in rest)
            case "or":
                return any(self._is_satisfied(part, bound, state) for part in rest)
            case "not":
                return not self._is_satisfied(rest[0], bound, state)
            case "imply":
                return not self._is_satisfied(rest[0], bound, state) or self._is_satisfied(rest[1], bound, state)
            case "forall" | "exists":
                holds = (self._is_satisfied(rest[1], extended, state) for extended in self._extensions(node, bound))
                return all(holds) if node.head == "forall" else any(holds)
            case "=":
                return bound.get(str(rest[0]), str(rest[0])) == bound.get(str(rest[1]), str(rest[1]))
            case ">=":
                return self._number(rest[0], bound, state) >= self._number(rest[1], bound, state)
            case _:
                return _fact(node, bound) in state


def _fact(node: Node, bound: Mapping[str, str]) -> Fact:
    assert isinstance(node, Group)
    return tuple(bound.get(item.text, item.text) for item in node.items if isinstance(item, Word))


def _format_term(node: Node, bound: Mapping[str, str]) -> str:
    return f"({' '.join(_fact(node, bound))})"


def _number_fact(name: str, value: float) -> Fact:
    return "=", name, f"{value:.9g}"


def _value(name: str, state: State) -> float:
    return next(float(fact[2]) for fact in state if fact[:2] == ("=", name))
