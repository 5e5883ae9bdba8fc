"""Converts PDDL effects to Entish: what an action adds, deletes and calculates, and under which conditions (`when`)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import reduce

from somrs.entish import Attribute, Call, Comparison, Formula, Name, Relation
from somrs.entish.formula import substitute, substitute_term
from somrs.sites.pddl.formulas import FormulaReader
from somrs.sites.pddl.sums import Sum, single_factor
from somrs.sites.pddl.syntax import Domain, typed_names
from somrs.sites.pddl.text import Group, Node

_COUNTING = ("increase", "decrease", "scale-up", "scale-down", "assign")


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
    conditional: list[ConditionalEffects] = field(default_factory=list)

    def joined(self, other: Effects) -> Effects | None:
        """Both effects at once; None if they give an attribute two values."""
        values = dict(self.values)
        for target, setting in other.values.items():
            combined = values[target].combine(setting) if target in values else setting
            if combined is None:
                return None
            values[target] = combined
        costs = [effects.cost for effects in (self, other) if effects.cost is not None]
        return Effects(
            adds=[*self.adds, *other.adds],
            deletes=[*self.deletes, *other.deletes],
            values=values,
            cost=reduce(Sum.__add__, costs) if costs else None,
            conditional=[*self.conditional, *other.conditional],
        )

    def cases(self) -> Iterator[tuple[tuple[Formula, ...], Effects]]:
        """Each combination of conditions that hold or fail, with the effects in that case, which are without conditions."""
        if not self.conditional:
            yield (), self
            return
        first, *rest = self.conditional
        others = replace(self, conditional=rest)
        for conditions, effects in others.cases():
            yield (first.fails, *conditions), effects
        both = others.joined(first.effects)
        for conditions, effects in both.cases() if both is not None else ():
            yield (first.holds, *conditions), effects

    def resolved(self, choice: Mapping[str, Name], settle: Callable[[Formula], Formula | bool]) -> Effects | None:
        """The effects with these objects for variables, without the conditions that `settle` decides; None if they give an attribute two
        values."""
        result = Effects(adds=_substituted(self.adds, choice), deletes=_substituted(self.deletes, choice))
        result.cost = self.cost.substituted(choice) if self.cost is not None else None
        for setting in self.values.values():
            target = substitute_term(setting.target, choice)
            assert isinstance(target, Attribute)
            if target in result.values:
                return None
            result.values[target] = Setting(target, setting.amount.substituted(choice), setting.adds)
        for conditional in self.conditional:
            effects = conditional.effects.resolved(choice, settle)
            holds, fails = settle(substitute(conditional.holds, choice)), settle(substitute(conditional.fails, choice))
            if holds is True:
                joined = result.joined(effects) if effects is not None else None
                if joined is None:
                    return None
                result = joined
            elif effects is not None and not isinstance(holds, bool) and not isinstance(fails, bool):
                result.conditional.append(ConditionalEffects(holds=holds, fails=fails, effects=effects))
        return result

    def count_conditions(self) -> int:
        return sum(1 + conditional.effects.count_conditions() for conditional in self.conditional)


def _substituted(atoms: Iterable[Relation], choice: Mapping[str, Name]) -> list[Relation]:
    return [atom for atom in (substitute(atom, choice) for atom in atoms) if isinstance(atom, Relation)]


@dataclass(frozen=True, slots=True, kw_only=True)
class ConditionalEffects:
    """Effects that an action has if `holds`, and has not if `fails`, which is the opposite condition."""

    holds: Formula
    fails: Formula
    effects: Effects


class EffectReader:
    """Reads the effects of one action, and notes mistakes in them."""

    def __init__(self, formulas: FormulaReader) -> None:
        self.formulas, self.mistakes, self.subject = formulas, formulas.mistakes, formulas.subject

    def effects(self, node: Node) -> Effects:
        effects = Effects()
        self._read(node, effects)
        return effects

    def _read(self, node: Node, effects: Effects) -> None:
        if not isinstance(node, Group) or not node.head:
            self.formulas.note_mistake(node, f"{str(node)[:60]} is not an effect; an effect is a group that begins with a word")
            return
        rest = node.items[1:]
        if node.head in self.formulas.symbols.domain.predicates:
            self._read_atom(node, effects.adds)
            return
        match node.head, rest:
            case "and", _:
                for part in rest:
                    self._read(part, effects)
            case "not", [Group() as atom]:
                self._read_atom(atom, effects.deletes)
            case "forall", [Group() as quantified, body]:
                for reader in self.formulas.instances(typed_names(quantified.items, self.mistakes)):
                    EffectReader(reader)._read(body, effects)
            case "when", [condition, body]:
                self._read_conditional(condition, body, effects)
            case head, _ if head in _COUNTING:
                self._read_number(node, effects)
            case (("forall" | "when"), _):
                self.formulas.note_mistake(node, f"{node.head} takes two groups: ({node.head} (...) (...))")
            case (("or" | "oneof" | "probabilistic"), _):
                message = f"{node.head} in an effect is not supported; an effect states what becomes true or false"
                self.mistakes.unsupported(node, self.subject, message)
            case _:
                self._read_atom(node, effects.adds)

    def _read_atom(self, node: Group, atoms: list[Relation]) -> None:
        if (atom := self.formulas.atom(node)) is not None:
            atoms.append(atom)

    def _read_conditional(self, condition: Node, body: Node, effects: Effects) -> None:
        settle = self.formulas.symbols.settle
        holds, fails = self.formulas.condition(condition), self.formulas.condition(condition, negated=True)
        settled = holds is None or fails is None or settle(holds)
        if settled is True:
            self._read(body, effects)
        elif settled is not False and fails is not None:
            opposite = settle(fails)
            assert not isinstance(opposite, bool), "a condition is open if its opposite is"
            conditional = self.effects(body)
            if settled in conditional.deletes:  # to delete what does not hold changes nothing
                conditional.deletes.remove(settled)
                effects.deletes.append(settled)
            if opposite in conditional.adds:
                conditional.adds.remove(opposite)
                effects.adds.append(opposite)
            if conditional != Effects():
                effects.conditional.append(ConditionalEffects(holds=settled, fails=opposite, effects=conditional))

    def _read_number(self, node: Group, effects: Effects) -> None:
        """Read a numeric effect: a change of an attribute, or of the cost."""
        if len(node.items) != 3 or not isinstance(node.items[1], Group):
            self.formulas.note_mistake(node, f"{node.head} takes a function and a number: ({node.head} (total-cost) 1)")
            return
        function = node.items[1]
        if function.head == self.formulas.symbols.cost and node.head == "increase":
            if (amount := self.formulas.sum(node.items[2])) is not None:
                effects.cost = amount if effects.cost is None else effects.cost + amount
            return
        if function.head == "total-cost" and self.formulas.symbols.cost is None:
            return  # no metric uses it, so no plan depends on it
        target, amount = self.formulas.sum(function), self.formulas.sum(node.items[2])
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
            self.formulas.note_mistake(node, f"{node.items[1]} is changed in another way by the same action; keep one of the two changes")


def _setting(operator: str, attribute: Attribute, target: Sum, amount: Sum) -> Setting | None:
    match operator:
        case "assign":
            return Setting(attribute, amount, adds=False)
        case "increase" | "decrease":
            return Setting(attribute, amount if operator == "increase" else amount.times(-1), adds=True)
        case "scale-up":
            return Setting(attribute, target * amount, adds=False)
    return Setting(attribute, target.times(1 / amount.number), adds=False) if amount.number else None


def changed_predicates(domain: Domain) -> set[str]:
    """The predicates of the facts that actions may add or delete."""
    changed: set[str] = set()
    waiting = [action.effect for action in domain.actions.values()]
    while waiting:
        node = waiting.pop()
        if not isinstance(node, Group):
            continue
        if node.head in domain.predicates:
            changed.add(node.head)
        elif node.head in ("and", "not", "forall", "when"):
            waiting += node.items[1:] if node.head in ("and", "not") else node.items[2:]
    return changed
