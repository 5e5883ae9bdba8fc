"""Converts PDDL conditions and terms to Entish. `effects.py` converts effects.

The objects of a problem are known: `forall` becomes one condition for each of them, `exists` a variable that the planner binds.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import product

from somrs.entish import And, Attribute, Call, Comparison, Formula, Name, Not, Or, Relation, Term, Variable
from somrs.entish.formula import conjunction, conjuncts, disjunction, variables
from somrs.ontology.objects import Fact
from somrs.ontology.services import PROVIDER
from somrs.sites.pddl.kinds import Kinds, Sorts
from somrs.sites.pddl.names import Names
from somrs.sites.pddl.sums import Sum, constant, single_factor
from somrs.sites.pddl.syntax import Domain, Signature, Typed, typed_names
from somrs.sites.pddl.text import Group, Mistakes, Node, Word, number

_COMPARISONS = ("=", "<", "<=", ">", ">=")
_OPPOSITES = {"=": "!=", "<": ">=", "<=": ">", ">": "<=", ">=": "<"}
_REFUSED = {
    "when": "when belongs in an effect; in a condition, write imply",
    "preference": "preferences are not supported; state a goal",
}

Scope = Mapping[str, tuple[Variable | Name, Sorts]]
"""The variables of PDDL, with the terms that they stand for and the possible types of those."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SymbolTable:
    """The names of one domain and one problem, in PDDL and in Entish."""

    domain: Domain
    kinds: Kinds
    objects: Names
    relations: Names
    attributes: Names
    functions: Names
    types: Mapping[str, str]
    """The PDDL type of each object."""
    world: str
    """The argument of predicates and functions without parameters."""
    cost: str | None
    """The function that the plan should minimise."""
    facts: Collection[Fact]
    """The facts of the initial state."""
    changing: frozenset[str]
    """The relations that actions change; all others stay as they are initially."""

    @property
    def contradiction(self) -> Formula:
        return Comparison(Name(self.world), "!=", Name(self.world))

    def objects_of(self, thing: Typed) -> list[str]:
        """The PDDL names of the objects that a variable with this declaration stands for."""
        sorts = self.kinds.sorts(thing)
        return [name for name, type_name in self.types.items() if type_name in sorts]

    def settle(self, formula: Formula) -> Formula | bool:
        """The formula without the parts that facts decide which no action changes; a truth value if they decide all of it."""
        match formula:
            case Relation(name, arguments) if name not in self.changing and all(isinstance(argument, Name) for argument in arguments):
                return Fact(name, tuple(argument.name for argument in arguments)) in self.facts
            case Comparison(Name() as left, "=" | "!=" as operator, Name() as right):
                return (left == right) is (operator == "=")
            case Not(atom) if isinstance(settled := self.settle(atom), bool):
                return not settled
            case And(parts) | Or(parts):
                return self.join([self.settle(part) for part in parts], isinstance(formula, And))
        return formula

    def join(self, parts: Iterable[Formula | bool], is_conjunction: bool) -> Formula | bool:
        """The conjunction or disjunction of the parts."""
        open_parts: list[Formula] = []
        for part in parts:
            if not isinstance(part, bool):
                open_parts.append(part)
            elif part is not is_conjunction:
                return part
        if not open_parts:
            return is_conjunction
        return conjunction(*open_parts) if is_conjunction else disjunction(*open_parts)


class FormulaReader:
    """Reads the formulas of one action, goal or initial state, and notes mistakes in them."""

    def __init__(self, symbols: SymbolTable, mistakes: Mistakes, subject: str, scope: Scope) -> None:
        self.symbols, self.mistakes, self.subject, self.scope = symbols, mistakes, subject, scope

    def note_mistake(self, node: Node, message: str) -> None:
        self.mistakes.note(node, self.subject, "condition", message)

    # Conditions

    def condition(self, node: Node, negated: bool = False) -> Formula | None:
        """The formula; None for an empty condition, or after a mistake."""
        if not isinstance(node, Group) or not node.head:
            self.note_mistake(node, f"{str(node)[:60]} is not a condition; a condition is a group that begins with a word")
            return None
        head, rest = node.head, node.items[1:]
        if head in _REFUSED and head not in self.symbols.domain.predicates:
            self.mistakes.unsupported(node, self.subject, _REFUSED[head])
            return None
        match head:
            case "and" | "or":
                return self._join_conditions(rest, (head == "and") is not negated, negated)
            case "not" if len(rest) == 1:
                return self.condition(rest[0], not negated)
            case "imply" if len(rest) == 2:
                alternative = Group(
                    (Word("or", "or", node.line), Group((Word("not", "not", node.line), rest[0]), node.line), rest[1]), node.line
                )
                return self.condition(alternative, negated)
            case "forall" | "exists" if len(rest) == 2 and isinstance(rest[0], Group):
                return self._quantified(typed_names(rest[0].items, self.mistakes), rest[1], (head == "forall") is not negated, negated)
            case _ if head in _COMPARISONS:
                return self._comparison(node, negated)
            case _:
                atom = self.atom(node)
                return Not(atom) if atom is not None and negated else atom

    def _join_conditions(self, parts: tuple[Node, ...], is_conjunction: bool, negated: bool) -> Formula | None:
        formulas = [self.condition(part, negated) for part in parts]
        known_formulas = [formula for formula in formulas if formula is not None]
        if not known_formulas or (not is_conjunction and len(known_formulas) < len(formulas)):
            return None
        return conjunction(*known_formulas) if is_conjunction else disjunction(*known_formulas)

    # Quantifiers

    def instances(self, quantified: Iterable[Typed]) -> Iterator[FormulaReader]:
        """A reader for each choice of objects for the quantified variables."""
        things = [*quantified]
        for names in product(*(self.symbols.objects_of(thing) for thing in things)):
            objects = {
                thing.name: (Name(self.symbols.objects.entish(name)), frozenset({self.symbols.types[name]}))
                for thing, name in zip(things, names, strict=True)
            }
            yield FormulaReader(self.symbols, self.mistakes, self.subject, {**self.scope, **objects})

    def _quantified(self, quantified: Iterable[Typed], body: Node, is_conjunction: bool, negated: bool) -> Formula | None:
        """One condition for each object; what facts that never change decide is left out. One variable for some object, if possible."""
        things = [*quantified]
        if not is_conjunction and (witnessed := self._witnessed(things, body, negated)) is not None:
            return witnessed
        formulas = [reader.condition(body, negated) for reader in self.instances(things)]
        settled = self.symbols.join((formula is None or self.symbols.settle(formula) for formula in formulas), is_conjunction)
        return None if settled is True else self.symbols.contradiction if settled is False else settled

    def _witnessed(self, things: Sequence[Typed], body: Node, negated: bool) -> Formula | None:
        """The body with a variable for each of the things, which the planner binds; None if the body only says what must not hold."""
        taken = {term.name for term, _ in self.scope.values() if isinstance(term, Variable)}
        names = Names([PROVIDER, *taken])
        scope, selections = dict(self.scope), list[Formula]()
        for thing in things:
            sorts = self.symbols.kinds.sorts(thing)
            kind = self.symbols.kinds.kind(sorts, thing)
            variable = Variable(names.fresh(thing.written), kind.type)
            scope[thing.name] = variable, sorts
            if kind.relation is not None:
                selections.append(Relation(kind.relation, (variable,)))
        formula = FormulaReader(self.symbols, self.mistakes, self.subject, scope).condition(body, negated)
        if formula is None:
            return None
        bound = {name for part in conjuncts(formula) if isinstance(part, Relation) for name in variables(part)}
        has_all = all(term.name in bound for name, (term, _) in scope.items() if name not in self.scope)
        return conjunction(formula, *selections) if has_all else None

    def atom(self, node: Group) -> Relation | None:
        """The relation for a predicate. A predicate without parameters has the world as argument."""
        signature = self.symbols.domain.predicates.get(node.head)
        if signature is None:
            self.note_mistake(
                node, f"there is no predicate {node.items[0] if node.items else ''}; declare it in :predicates, or correct the name"
            )
            return None
        arguments = self._arguments(node, signature)
        if arguments is None:
            return None
        return Relation(self.symbols.relations.entish(node.head), arguments or (Name(self.symbols.world),))

    def _arguments(self, node: Group, signature: Signature) -> tuple[Name | Variable, ...] | None:
        argument_nodes = node.items[1:]
        if len(argument_nodes) != len(signature.parameters):
            self.note_mistake(node, f"{node.items[0]} takes {len(signature.parameters)} arguments, not {len(argument_nodes)}")
            return None
        arguments = [self._object(item, parameter) for item, parameter in zip(argument_nodes, signature.parameters, strict=True)]
        known_arguments = tuple(argument for argument in arguments if argument is not None)
        return known_arguments if len(known_arguments) == len(arguments) else None

    def _object(self, node: Node, parameter: Typed | None) -> Name | Variable | None:
        if not isinstance(node, Word):
            self.note_mistake(node, f"{str(node)[:60]} is not an object; write its name, or a variable")
            return None
        sorts, term = self._meaning(node)
        if term is None:
            hint = "as a parameter of the action" if node.text.startswith("?") else "among the objects"
            self.note_mistake(node, f"{node} is not known; declare it {hint}, or correct the name")
        elif parameter is not None and not sorts & self.symbols.kinds.sorts(parameter):
            self.note_mistake(node, f"{node} cannot be a {' or '.join(parameter.types)}, which is expected here")
            return None
        return term

    def _meaning(self, word: Word) -> tuple[Sorts, Name | Variable | None]:
        if word.text.startswith("?"):
            term, sorts = self.scope.get(word.text[1:], (None, frozenset[str]()))
            return sorts, term
        if word.text not in self.symbols.types:
            return frozenset(), None
        return frozenset({self.symbols.types[word.text]}), Name(self.symbols.objects.entish(word.text))

    def _comparison(self, node: Group, negated: bool) -> Formula | None:
        if len(node.items) != 3:
            self.note_mistake(node, f"{node.head} compares two terms, not {len(node.items) - 1}")
            return None
        sides = [self._side(item) for item in node.items[1:]]
        left_term, right_term = sides
        if left_term is None or right_term is None:
            return None
        objects = [isinstance(side, Name | Variable) for side in sides]
        if any(objects) and (node.head != "=" or not all(objects)):
            self.note_mistake(node, f"{node} is not a valid comparison: objects are compared only by =, numbers only with numbers")
            return None
        return Comparison(left_term, _OPPOSITES[node.head] if negated else node.head, right_term)

    def _side(self, node: Node) -> Term | None:
        return self._object(node, None) if isinstance(node, Word) and number(node) is None else self.number(node)

    # Numbers

    def number(self, node: Node) -> Term | None:
        """A numeric term; None after a mistake."""
        total = self.sum(node)
        return total.term if total is not None else None

    def sum(self, node: Node) -> Sum | None:
        if (value := number(node)) is not None:
            return constant(value)
        if not isinstance(node, Group) or not node.head:
            self.note_mistake(node, f"{str(node)[:60]} is not a number; write one, or a function such as (distance ?a ?b)")
            return None
        return self._arithmetic(node) if node.head in ("+", "-", "*", "/") else self._function(node)

    def _arithmetic(self, node: Group) -> Sum | None:
        parts = [part for item in node.items[1:] if (part := self.sum(item)) is not None]
        if len(parts) < len(node.items) - 1:
            return None
        match node.head, parts:
            case "-", [operand]:
                return operand.times(-1)
            case "-", [first, second]:
                return first + second.times(-1)
            case "/", [first, second] if second.number:
                return first.times(1 / second.number)
            case "/", [_, _]:
                self.mistakes.unsupported(node, self.subject, "division is supported only by a number other than 0")
                return None
            case (("+" | "*"), [first, _, *_]):
                return reduce(
                    lambda left_sum, right_sum: left_sum + right_sum if node.head == "+" else left_sum * right_sum, parts[1:], first
                )
        self.note_mistake(node, f"{node.head} takes two numbers: ({node.head} 1 2)")
        return None

    def _function(self, node: Group) -> Sum | None:
        """An attribute of the single argument; an attribute of the world without arguments; a table entry for several."""
        signature = self.symbols.domain.functions.get(node.head)
        if signature is None:
            self.note_mistake(node, f"there is no function {node.items[0]}; declare it in :functions, or correct the name")
            return None
        if node.head == self.symbols.cost:
            self.mistakes.unsupported(node, self.subject, f"conditions on {node.head}, which the plan minimises, are not supported")
            return None
        arguments = self._arguments(node, signature)
        if arguments is None:
            return None
        if len(arguments) > 1:
            return single_factor(Call(self.symbols.functions.entish(node.head), arguments))
        return single_factor(Attribute(arguments[0] if arguments else Name(self.symbols.world), self.symbols.attributes.entish(node.head)))
