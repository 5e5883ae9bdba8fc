"""A task with counters as ground numeric PDDL 2.1 (Fox and Long 2003), for numeric engines. All names are numbers."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import takewhile

from somrs.entish import Arithmetic, Comparison, Name, Not, Number, Term, Variable
from somrs.ontology.units import convert_unit
from somrs.ontology.values import ROUNDING
from somrs.planner.grounding.task import Assignment, Move, Task
from somrs.planner.model.vocabulary import Inexpressible
from somrs.planner.search.counting import Counters, NumericCondition, NumericEffect

_INDENT = "\n  "


class NumericTask:
    """The PDDL domain and problem. Moves become actions, named by their index in `task.moves`; the goal's moves only add `(reached)`."""

    def __init__(self, task: Task, counters: Counters) -> None:
        self._task, self._counters = task, counters
        self.domain = self._domain()
        self.problem = self._problem()

    def decode_moves(self, names: list[str]) -> list[Move]:
        """The moves of an engine's plan up to the one that only reaches the goal. Moves after it may lead away from the goal."""
        moves = (self._task.moves[int(name.lower().removeprefix("a"))] for name in names)
        return [*takewhile(lambda move: not move.action.operator.reaches_goal, moves)]

    def _domain(self) -> str:
        atoms = " ".join(_atom((variable, value)) for variable, values in enumerate(self._task.values) for value in range(len(values)))
        functions = " ".join(f"(n{number})" for number in range(len(self._counters.names)))
        actions = "\n".join(self._action(number, move) for number, move in enumerate(self._task.moves))
        head = "(define (domain d) (:requirements :strips :numeric-fluents :conditional-effects)"
        return f"{head}\n(:predicates (reached) {atoms})\n(:functions {functions})\n{actions})\n"

    def _problem(self) -> str:
        facts = " ".join(map(_atom, enumerate(self._task.initial)))
        numbers = " ".join(f"(= (n{n}) {_plain(value or 0.0)})" for n, value in enumerate(self._counters.initial))
        return f"(define (problem p) (:domain d)\n(:init {facts} {numbers})\n(:goal (reached)))\n"

    def _action(self, number: int, move: Move) -> str:
        preconditions = [*map(_atom, move.preconditions)]
        for condition in self._counters.numeric_conditions[move]:
            preconditions.extend(self._condition(condition))
        effects = [part for effect in move.effects for part in self._effect(move, *effect)]
        for numeric_effect in self._counters.numeric_effects[move]:
            value = self._expression(numeric_effect.source, self._counters.unit(numeric_effect.counter))
            preconditions.extend(self._range(numeric_effect, value))
            effects.append(f"(assign (n{numeric_effect.counter}) {value})")
        if move.action.operator.reaches_goal:
            effects = ["(reached)"]
        return f"(:action a{number} :parameters () :precondition (and {' '.join(preconditions)}){_INDENT}:effect (and {' '.join(effects)}))"

    def _effect(self, move: Move, conditions: tuple[Assignment, ...], variable: int, value: int) -> Iterator[str]:
        """The literals that give a variable a value and delete its old value, or all other values if the old one is unknown."""
        known_value = dict((*move.preconditions, *conditions)).get(variable)
        old = [known_value] if known_value is not None else range(len(self._task.values[variable]))
        literals = [_atom((variable, value)), *(f"(not {_atom((variable, other_value))})" for other_value in old if other_value != value)]
        if conditions:
            yield f"(when (and {' '.join(map(_atom, conditions))}) (and {' '.join(literals)}))"
        else:
            yield from literals

    def _condition(self, condition: NumericCondition) -> Iterator[str]:
        if isinstance(condition.literal, Not):
            atom = condition.literal.atom
            assert isinstance(atom, Comparison), "counters are compared"
            opposite = {"<": ">=", "<=": ">", ">": "<=", ">=": "<", "!=": "="}.get(atom.operator)
            if opposite is None:
                raise Inexpressible(condition.literal, "an engine does not support that two numbers differ")
            yield from self._comparison(Comparison(atom.left, opposite, atom.right), condition)
        else:
            assert isinstance(condition.literal, Comparison), "counters are compared"
            yield from self._comparison(condition.literal, condition)

    def _comparison(self, comparison: Comparison, condition: NumericCondition) -> Iterator[str]:
        """The comparison in PDDL. Numbers within the attribute's tolerance are equal, as in `ontology.values`."""
        counter = condition.read_counters[0]
        left_expression = self._expression(comparison.left, self._counters.unit(counter))
        right_expression = self._expression(comparison.right, self._counters.unit(counter))
        attribute = self._counters.attributes[counter]
        slack = _plain((attribute.tolerance if attribute is not None else 0.0) + ROUNDING)
        match comparison.operator:
            case "=":
                yield f"(>= {left_expression} (- {right_expression} {slack}))"
                yield f"(<= {left_expression} (+ {right_expression} {slack}))"
            case ">=":
                yield f"(>= {left_expression} (- {right_expression} {slack}))"
            case "<=":
                yield f"(<= {left_expression} (+ {right_expression} {slack}))"
            case ">":
                yield f"(> {left_expression} (+ {right_expression} {slack}))"
            case "<":
                yield f"(< {left_expression} (- {right_expression} {slack}))"
            case _:
                raise Inexpressible(comparison, "an engine does not support that two numbers differ")

    def _range(self, numeric_effect: NumericEffect, value: str) -> Iterator[str]:
        attribute = self._counters.attributes[numeric_effect.counter]
        if numeric_effect.read_counters and attribute is not None:
            if attribute.minimum is not None:
                yield f"(>= {value} {_plain(attribute.minimum)})"
            if attribute.maximum is not None:
                yield f"(<= {value} {_plain(attribute.maximum)})"

    def _expression(self, term: Term, unit: str | None) -> str:
        """The term as a PDDL expression in the given unit."""
        match term:
            case Variable(name):
                counter = self._counters.names.index(name)
                return _scaled(f"(n{counter})", self._counters.unit(counter), unit, term)
            case Arithmetic(left_term, "*", right_term):
                return self._product(left_term, right_term, unit)
            case Arithmetic(left_term, sign, right_term):
                return f"({sign} {self._expression(left_term, unit)} {self._expression(right_term, unit)})"
            case Number(value, None):
                return _plain(value)
            case Name():
                raise Inexpressible(term, "it is no number")
        measured = self._counters.measure_term(term)
        if measured is None:
            raise Inexpressible(term, "it has no value")
        return _converted(measured, unit, term)

    def _product(self, left_term: Term, right_term: Term, unit: str | None) -> str:
        """A product in PDDL. One factor has to be constant, because engines only calculate linear expressions."""
        for factor, other_factor in ((left_term, right_term), (right_term, left_term)):
            constant = self._counters.measure_term(factor)
            if constant is not None:
                whole = self._counters.measure_term(other_factor)
                if whole is not None:
                    product = self._counters.measure_term(Arithmetic(left_term, "*", right_term))
                    assert product is not None, "both factors are known"
                    return _converted(product, unit, left_term)
                if constant.unit is None:
                    return f"(* {_plain(constant.value)} {self._expression(other_factor, unit)})"
        raise Inexpressible(Arithmetic(left_term, "*", right_term), "an engine does not multiply two numbers that change, or with units")


def _atom(assignment: Assignment) -> str:
    return f"(v{assignment[0]}-{assignment[1]})"


def _plain(number: float) -> str:
    """The number in PDDL notation, which has no exponent."""
    return f"{number:.12f}".rstrip("0").rstrip(".")


def _converted(number: Number, unit: str | None, term: Term) -> str:
    if number.unit is None or unit is None:
        return _plain(number.value)
    value = convert_unit(number.value, number.unit, unit)
    if value is None:
        raise Inexpressible(term, f"{number.unit} and {unit} do not measure the same thing")
    return _plain(value)


def _scaled(text: str, unit: str | None, target_unit: str | None, term: Term) -> str:
    if unit is None or target_unit is None or unit == target_unit:
        return text
    offset, factor = convert_unit(0.0, unit, target_unit), convert_unit(1.0, unit, target_unit)
    if offset != 0 or factor is None:
        raise Inexpressible(term, f"{unit} and {target_unit} differ by more than a factor")
    return f"(* {_plain(factor)} {text})"
