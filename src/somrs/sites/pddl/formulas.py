"""Conditions and effects of PDDL in Entish."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import reduce

from somrs.entish import Attribute, Call, Comparison, Formula, Name, Not, Relation, Term, Variable
from somrs.entish.formula import conjunction, disjunction
from somrs.sites.pddl.kinds import Kinds, Sorts
from somrs.sites.pddl.names import Names
from somrs.sites.pddl.sums import Sum, constant, one
from somrs.sites.pddl.syntax import Domain, Signature, Typed
from somrs.sites.pddl.text import Group, Mistakes, Node, Word, number

_COMPARISONS = ("=", "<", "<=", ">", ">=")
_OPPOSITES = {"=": "!=", "<": ">=", "<=": ">", ">": "<=", ">=": "<"}
_REFUSED = {
    "forall": "forall is not read; write one condition for each object, or a predicate that stands for it",
    "exists": "exists is not read; make the variable a parameter",
    "when": "effects under a condition are not read; make one action for each case",
    "preference": "preferences are not read; state a goal",
}
_COUNTING = ("increase", "decrease", "scale-up", "scale-down", "assign")


@dataclass(frozen=True, slots=True, kw_only=True)
class Words:
    """What formulas may speak of: the names of one domain and one problem, on both sides."""

    domain: Domain
    kinds: Kinds
    objects: Names
    relations: Names
    attributes: Names
    functions: Names
    types: Mapping[str, str]
    """The PDDL type of each object."""
    world: str
    """The object that what is of no object is said of."""
    cost: str | None
    """The function that the plan is to keep small."""


@dataclass(frozen=True, slots=True)
class Setting:
    """What becomes of an attribute: the amount, or what it was and the amount, if it `adds`."""

    target: Attribute
    amount: Sum
    adds: bool

    @property
    def formula(self) -> Comparison:
        return Comparison(self.target, "=", (one(self.target) + self.amount if self.adds else self.amount).term)

    def and_also(self, other: Setting) -> Setting | None:
        """Both, for the same attribute; None if that makes no sense."""
        return Setting(self.target, self.amount + other.amount, adds=True) if self.adds and other.adds else None


@dataclass(slots=True)
class Effects:
    """What an action does."""

    adds: list[Relation] = field(default_factory=list)
    deletes: list[Relation] = field(default_factory=list)
    values: dict[Attribute, Setting] = field(default_factory=dict)
    cost: Sum | None = None


class Speech:
    """What is said in one action, or in a goal: its variables, and where mistakes in it are noted."""

    def __init__(self, words: Words, mistakes: Mistakes, subject: str, variables: Mapping[str, tuple[Variable, Sorts]]) -> None:
        self.words, self.mistakes, self.subject, self.variables = words, mistakes, subject, variables

    def _wrong(self, node: Node, message: str) -> None:
        self.mistakes.note(node, self.subject, "condition", message)

    # Conditions

    def condition(self, node: Node, negated: bool = False) -> Formula | None:
        """The formula; None when it says nothing, or after a mistake."""
        if not isinstance(node, Group) or not node.head:
            self._wrong(node, f"{str(node)[:60]} is no condition; a condition is a group that begins with a word")
            return None
        head, rest = node.head, node.items[1:]
        if head in _REFUSED and head not in self.words.domain.predicates:
            self.mistakes.unsupported(node, self.subject, _REFUSED[head])
            return None
        match head:
            case "and" | "or":
                return self._joined(rest, (head == "and") is not negated, negated)
            case "not" if len(rest) == 1:
                return self.condition(rest[0], not negated)
            case "imply" if len(rest) == 2:
                either = Group(
                    (Word("or", "or", node.line), Group((Word("not", "not", node.line), rest[0]), node.line), rest[1]), node.line
                )
                return self.condition(either, negated)
            case _ if head in _COMPARISONS:
                return self._comparison(node, negated)
            case _:
                atom = self.atom(node)
                return Not(atom) if atom is not None and negated else atom

    def _joined(self, parts: tuple[Node, ...], all_of: bool, negated: bool) -> Formula | None:
        found = [self.condition(part, negated) for part in parts]
        said = [formula for formula in found if formula is not None]
        if not said or (not all_of and len(said) < len(found)):
            return None
        return conjunction(*said) if all_of else disjunction(*said)

    def atom(self, node: Group) -> Relation | None:
        """A predicate of objects; one of none is said of the world."""
        signature = self.words.domain.predicates.get(node.head)
        if signature is None:
            self._wrong(node, f"there is no predicate {node.items[0] if node.items else ''}; declare it in :predicates, or mend the name")
            return None
        arguments = self._arguments(node, signature)
        if arguments is None:
            return None
        return Relation(self.words.relations.entish(node.head), arguments or (Name(self.words.world),))

    def _arguments(self, node: Group, signature: Signature) -> tuple[Name | Variable, ...] | None:
        given = node.items[1:]
        if len(given) != len(signature.parameters):
            self._wrong(node, f"{node.items[0]} is of {len(signature.parameters)}, and {len(given)} are given")
            return None
        found = [self._object(item, wanted) for item, wanted in zip(given, signature.parameters, strict=True)]
        known = tuple(argument for argument in found if argument is not None)
        return known if len(known) == len(found) else None

    def _object(self, node: Node, wanted: Typed | None) -> Name | Variable | None:
        if not isinstance(node, Word):
            self._wrong(node, f"{str(node)[:60]} is no object; write its name, or a variable")
            return None
        sorts, found = self._meaning(node)
        if found is None:
            where = "as a parameter of the action" if node.text.startswith("?") else "among the objects"
            self._wrong(node, f"{node} is not known; declare it {where}, or mend the name")
        elif wanted is not None and not sorts & self.words.kinds.sorts(wanted):
            self._wrong(node, f"{node} can be no {' or '.join(wanted.types)}, and one is meant here")
            return None
        return found

    def _meaning(self, word: Word) -> tuple[Sorts, Name | Variable | None]:
        if word.text.startswith("?"):
            variable, sorts = self.variables.get(word.text[1:], (None, frozenset[str]()))
            return sorts, variable
        if word.text not in self.words.types:
            return frozenset(), None
        return frozenset({self.words.types[word.text]}), Name(self.words.objects.entish(word.text))

    def _comparison(self, node: Group, negated: bool) -> Formula | None:
        if len(node.items) != 3:
            self._wrong(node, f"{node.head} compares two, and {len(node.items) - 1} are given")
            return None
        sides = [self._side(item) for item in node.items[1:]]
        left, right = sides
        if left is None or right is None:
            return None
        objects = [isinstance(side, Name | Variable) for side in sides]
        if any(objects) and (node.head != "=" or not all(objects)):
            self._wrong(node, f"{node} compares what cannot be compared: objects by = alone, numbers with numbers")
            return None
        return Comparison(left, _OPPOSITES[node.head] if negated else node.head, right)

    def _side(self, node: Node) -> Term | None:
        return self._object(node, None) if isinstance(node, Word) and number(node) is None else self.number(node)

    # Numbers

    def number(self, node: Node) -> Term | None:
        """A number, or what is reckoned from numbers."""
        found = self._sum(node)
        return found.term if found is not None else None

    def _sum(self, node: Node) -> Sum | None:
        if (value := number(node)) is not None:
            return constant(value)
        if not isinstance(node, Group) or not node.head:
            self._wrong(node, f"{str(node)[:60]} is no number; write one, or a function such as (distance ?a ?b)")
            return None
        return self._reckoned(node) if node.head in ("+", "-", "*", "/") else self._function(node)

    def _reckoned(self, node: Group) -> Sum | None:
        parts = [part for item in node.items[1:] if (part := self._sum(item)) is not None]
        if len(parts) < len(node.items) - 1:
            return None
        match node.head, parts:
            case "-", [one_]:
                return one_.times(-1)
            case "-", [first, second]:
                return first + second.times(-1)
            case "/", [first, second] if second.number:
                return first.times(1 / second.number)
            case "/", [_, _]:
                self.mistakes.unsupported(node, self.subject, "dividing by anything but a number other than 0 is not read")
                return None
            case (("+" | "*"), [first, _, *_]):
                return reduce(lambda a, b: a + b if node.head == "+" else a * b, parts[1:], first)
        self._wrong(node, f"{node.head} is of two numbers: ({node.head} 1 2)")
        return None

    def _function(self, node: Group) -> Sum | None:
        """An attribute of the one object; of the world, when there is none; else a table's entry."""
        signature = self.words.domain.functions.get(node.head)
        if signature is None:
            self._wrong(node, f"there is no function {node.items[0]}; declare it in :functions, or mend the name")
            return None
        if node.head == self.words.cost:
            self.mistakes.unsupported(node, self.subject, f"conditions on {node.head}, which the plan is to keep small, are not read")
            return None
        arguments = self._arguments(node, signature)
        if arguments is None:
            return None
        if len(arguments) > 1:
            return one(Call(self.words.functions.entish(node.head), arguments))
        return one(Attribute(arguments[0] if arguments else Name(self.words.world), self.words.attributes.entish(node.head)))

    # Effects

    def effects(self, node: Node) -> Effects:
        found = Effects()
        for part in _flat(node):
            self._effect(part, found)
        return found

    def _effect(self, node: Node, found: Effects) -> None:
        if not isinstance(node, Group) or not node.head:
            self._wrong(node, f"{str(node)[:60]} is no effect; an effect is a group that begins with a word")
            return
        inner = node.items[1] if node.head == "not" and len(node.items) == 2 else node
        if node.head in _COUNTING and node.head not in self.words.domain.predicates:
            self._counted(node, found)
        elif node.head in ("when", "forall", "or", "oneof", "probabilistic"):
            what = _REFUSED.get(node.head, f"{node.head} in an effect is not read; an effect says what becomes true and what false")
            self.mistakes.unsupported(node, self.subject, what)
        elif isinstance(inner, Group) and (atom := self.atom(inner)) is not None:
            (found.deletes if node.head == "not" else found.adds).append(atom)

    def _counted(self, node: Group, found: Effects) -> None:
        """A number that the action changes; or what it adds to the cost."""
        if len(node.items) != 3 or not isinstance(node.items[1], Group):
            self._wrong(node, f"{node.head} is of a function and a number: ({node.head} (total-cost) 1)")
            return
        function = node.items[1]
        if function.head == self.words.cost and node.head == "increase":
            if (amount := self._sum(node.items[2])) is not None:
                found.cost = amount if found.cost is None else found.cost + amount
            return
        if function.head == "total-cost" and self.words.cost is None:
            return  # no metric speaks of it, so that it changes nothing that a plan could depend on
        target, amount = self._sum(function), self._sum(node.items[2])
        attribute = target.term if target is not None else None
        if isinstance(attribute, Call):
            self.mistakes.unsupported(node, self.subject, "a function of several objects that actions change is not read")
        elif target is not None and amount is not None and isinstance(attribute, Attribute):
            self._set(node, _setting(node.head, attribute, target, amount), found)

    def _set(self, node: Group, setting: Setting | None, found: Effects) -> None:
        if setting is None:
            self.mistakes.unsupported(node, self.subject, "dividing by anything but a number other than 0 is not read")
        elif (there := found.values.get(setting.target)) is None:
            found.values[setting.target] = setting
        elif (both := there.and_also(setting)) is not None:
            found.values[setting.target] = both
        else:
            self._wrong(node, f"{node.items[1]} is changed in another way by the same action; say once what becomes of it")


def _setting(how: str, attribute: Attribute, target: Sum, amount: Sum) -> Setting | None:
    match how:
        case "assign":
            return Setting(attribute, amount, adds=False)
        case "increase" | "decrease":
            return Setting(attribute, amount if how == "increase" else amount.times(-1), adds=True)
        case "scale-up":
            return Setting(attribute, target * amount, adds=False)
    return Setting(attribute, target.times(1 / amount.number), adds=False) if amount.number else None


def _flat(node: Node) -> Iterator[Node]:
    if isinstance(node, Group) and node.head == "and":
        for part in node.items[1:]:
            yield from _flat(part)
    else:
        yield node
