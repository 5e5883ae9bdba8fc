"""Converts PDDL conditions and effects to Entish."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import reduce

from somrs.entish import Attribute, Call, Comparison, Formula, Name, Not, Relation, Term, Variable
from somrs.entish.formula import conjunction, disjunction
from somrs.sites.pddl.kinds import Kinds, Sorts
from somrs.sites.pddl.names import Names
from somrs.sites.pddl.sums import Sum, constant, single_factor
from somrs.sites.pddl.syntax import Domain, Signature, Typed
from somrs.sites.pddl.text import Group, Mistakes, Node, Word, number

_COMPARISONS = ("=", "<", "<=", ">", ">=")
_OPPOSITES = {"=": "!=", "<": ">=", "<=": ">", ">": "<=", ">=": "<"}
_REFUSED = {
    "forall": "forall is not supported; write one condition for each object, or use a predicate instead",
    "exists": "exists is not supported; make the variable a parameter",
    "when": "conditional effects are not supported; make one action for each case",
    "preference": "preferences are not supported; state a goal",
}
_COUNTING = ("increase", "decrease", "scale-up", "scale-down", "assign")


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


@dataclass(frozen=True, slots=True)
class Setting:
    """A numeric effect: the attribute is set to the amount, or increased by it if `adds`."""

    target: Attribute
    amount: Sum
    adds: bool

    @property
    def formula(self) -> Comparison:
        return Comparison(self.target, "=", (single_factor(self.target) + self.amount if self.adds else self.amount).term)

    def combine(self, setting: Setting) -> Setting | None:
        """Both effects on the same attribute combined; None unless both add."""
        return Setting(self.target, self.amount + setting.amount, adds=True) if self.adds and setting.adds else None


@dataclass(slots=True)
class Effects:
    """The effects of an action."""

    adds: list[Relation] = field(default_factory=list)
    deletes: list[Relation] = field(default_factory=list)
    values: dict[Attribute, Setting] = field(default_factory=dict)
    cost: Sum | None = None


class FormulaReader:
    """Reads the formulas of one action, goal or initial state, and notes mistakes in them."""

    def __init__(self, symbols: SymbolTable, mistakes: Mistakes, subject: str, variables: Mapping[str, tuple[Variable, Sorts]]) -> None:
        self.symbols, self.mistakes, self.subject, self.variables = symbols, mistakes, subject, variables

    def _note_mistake(self, node: Node, message: str) -> None:
        self.mistakes.note(node, self.subject, "condition", message)

    # Conditions

    def condition(self, node: Node, negated: bool = False) -> Formula | None:
        """The formula; None for an empty condition, or after a mistake."""
        if not isinstance(node, Group) or not node.head:
            self._note_mistake(node, f"{str(node)[:60]} is not a condition; a condition is a group that begins with a word")
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

    def atom(self, node: Group) -> Relation | None:
        """The relation for a predicate. A predicate without parameters has the world as argument."""
        signature = self.symbols.domain.predicates.get(node.head)
        if signature is None:
            self._note_mistake(
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
            self._note_mistake(node, f"{node.items[0]} takes {len(signature.parameters)} arguments, not {len(argument_nodes)}")
            return None
        arguments = [self._object(item, parameter) for item, parameter in zip(argument_nodes, signature.parameters, strict=True)]
        known_arguments = tuple(argument for argument in arguments if argument is not None)
        return known_arguments if len(known_arguments) == len(arguments) else None

    def _object(self, node: Node, parameter: Typed | None) -> Name | Variable | None:
        if not isinstance(node, Word):
            self._note_mistake(node, f"{str(node)[:60]} is not an object; write its name, or a variable")
            return None
        sorts, term = self._meaning(node)
        if term is None:
            hint = "as a parameter of the action" if node.text.startswith("?") else "among the objects"
            self._note_mistake(node, f"{node} is not known; declare it {hint}, or correct the name")
        elif parameter is not None and not sorts & self.symbols.kinds.sorts(parameter):
            self._note_mistake(node, f"{node} cannot be a {' or '.join(parameter.types)}, which is expected here")
            return None
        return term

    def _meaning(self, word: Word) -> tuple[Sorts, Name | Variable | None]:
        if word.text.startswith("?"):
            variable, sorts = self.variables.get(word.text[1:], (None, frozenset[str]()))
            return sorts, variable
        if word.text not in self.symbols.types:
            return frozenset(), None
        return frozenset({self.symbols.types[word.text]}), Name(self.symbols.objects.entish(word.text))

    def _comparison(self, node: Group, negated: bool) -> Formula | None:
        if len(node.items) != 3:
            self._note_mistake(node, f"{node.head} compares two terms, not {len(node.items) - 1}")
            return None
        sides = [self._side(item) for item in node.items[1:]]
        left_term, right_term = sides
        if left_term is None or right_term is None:
            return None
        objects = [isinstance(side, Name | Variable) for side in sides]
        if any(objects) and (node.head != "=" or not all(objects)):
            self._note_mistake(node, f"{node} is not a valid comparison: objects are compared only by =, numbers only with numbers")
            return None
        return Comparison(left_term, _OPPOSITES[node.head] if negated else node.head, right_term)

    def _side(self, node: Node) -> Term | None:
        return self._object(node, None) if isinstance(node, Word) and number(node) is None else self.number(node)

    # Numbers

    def number(self, node: Node) -> Term | None:
        """A numeric term; None after a mistake."""
        total = self._sum(node)
        return total.term if total is not None else None

    def _sum(self, node: Node) -> Sum | None:
        if (value := number(node)) is not None:
            return constant(value)
        if not isinstance(node, Group) or not node.head:
            self._note_mistake(node, f"{str(node)[:60]} is not a number; write one, or a function such as (distance ?a ?b)")
            return None
        return self._arithmetic(node) if node.head in ("+", "-", "*", "/") else self._function(node)

    def _arithmetic(self, node: Group) -> Sum | None:
        parts = [part for item in node.items[1:] if (part := self._sum(item)) is not None]
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
        self._note_mistake(node, f"{node.head} takes two numbers: ({node.head} 1 2)")
        return None

    def _function(self, node: Group) -> Sum | None:
        """An attribute of the single argument; an attribute of the world without arguments; a table entry for several."""
        signature = self.symbols.domain.functions.get(node.head)
        if signature is None:
            self._note_mistake(node, f"there is no function {node.items[0]}; declare it in :functions, or correct the name")
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

    # Effects

    def effects(self, node: Node) -> Effects:
        effects = Effects()
        for part in _flat(node):
            self._effect(part, effects)
        return effects

    def _effect(self, node: Node, effects: Effects) -> None:
        if not isinstance(node, Group) or not node.head:
            self._note_mistake(node, f"{str(node)[:60]} is not an effect; an effect is a group that begins with a word")
            return
        inner = node.items[1] if node.head == "not" and len(node.items) == 2 else node
        if node.head in _COUNTING and node.head not in self.symbols.domain.predicates:
            self._numeric_effect(node, effects)
        elif node.head in ("when", "forall", "or", "oneof", "probabilistic"):
            message = _REFUSED.get(node.head, f"{node.head} in an effect is not supported; an effect states what becomes true or false")
            self.mistakes.unsupported(node, self.subject, message)
        elif isinstance(inner, Group) and (atom := self.atom(inner)) is not None:
            (effects.deletes if node.head == "not" else effects.adds).append(atom)

    def _numeric_effect(self, node: Group, effects: Effects) -> None:
        """Read a numeric effect: a change of an attribute, or of the cost."""
        if len(node.items) != 3 or not isinstance(node.items[1], Group):
            self._note_mistake(node, f"{node.head} takes a function and a number: ({node.head} (total-cost) 1)")
            return
        function = node.items[1]
        if function.head == self.symbols.cost and node.head == "increase":
            if (amount := self._sum(node.items[2])) is not None:
                effects.cost = amount if effects.cost is None else effects.cost + amount
            return
        if function.head == "total-cost" and self.symbols.cost is None:
            return  # no metric uses it, so no plan depends on it
        target, amount = self._sum(function), self._sum(node.items[2])
        attribute = target.term if target is not None else None
        if isinstance(attribute, Call):
            self.mistakes.unsupported(node, self.subject, "a function of several objects that actions change is not supported")
        elif target is not None and amount is not None and isinstance(attribute, Attribute):
            self._set(node, _setting(node.head, attribute, target, amount), effects)

    def _set(self, node: Group, setting: Setting | None, effects: Effects) -> None:
        if setting is None:
            self.mistakes.unsupported(node, self.subject, "division is supported only by a number other than 0")
        elif (existing := effects.values.get(setting.target)) is None:
            effects.values[setting.target] = setting
        elif (combined := existing.combine(setting)) is not None:
            effects.values[setting.target] = combined
        else:
            self._note_mistake(node, f"{node.items[1]} is changed in another way by the same action; keep one of the two changes")


def _setting(operator: str, attribute: Attribute, target: Sum, amount: Sum) -> Setting | None:
    match operator:
        case "assign":
            return Setting(attribute, amount, adds=False)
        case "increase" | "decrease":
            return Setting(attribute, amount if operator == "increase" else amount.times(-1), adds=True)
        case "scale-up":
            return Setting(attribute, target * amount, adds=False)
    return Setting(attribute, target.times(1 / amount.number), adds=False) if amount.number else None


def _flat(node: Node) -> Iterator[Node]:
    if isinstance(node, Group) and node.head == "and":
        for part in node.items[1:]:
            yield from _flat(part)
    else:
        yield node
