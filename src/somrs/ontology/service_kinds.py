"""What the effect of a service can say, by its kind (paper, "Services"): only physical services change something."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from somrs.entish import Arithmetic, Attribute, Comparison
from somrs.entish.formula import conjuncts, terms, variables
from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.ontology.services import ServiceKind, ServiceType


def kind_problems(service: ServiceType) -> Iterator[str]:
    """What the effect says that a service of this kind cannot do. An effect that is not Entish is the concern of others."""
    if service.kind is ServiceKind.PHYSICAL:
        return
    try:
        parts = conjuncts(parse(service.effect))
    except FormulaError:
        return
    outputs = {output.name for output in service.outputs}
    for part in parts:
        if isinstance(part, Comparison) and _calculates(part):
            yield (
                f"a {service.kind} service changes nothing, and `{part}` gives an attribute a new value that depends on the present one; "
                "write kind: physical, or an effect that says what is found out"
            )
        elif service.kind is ServiceKind.SOFTWARE and outputs.isdisjoint(variables(part)):
            yield (
                f"a software service changes nothing: its effect says what its outputs are, and `{part}` names no output; "
                "declare one under outputs, or write kind: physical"
            )


def planning_notes(service: ServiceType) -> Iterator[str]:
    """What of a service type no plan can use: it is no mistake, but its author may not expect it.

    A plan knows an output only by what the effect says of it, and a number or a text as an input only by what a condition, an effect or a
    goal says of it.
    """
    for output in service.outputs:
        if output.name not in _mentioned(service.effect):
            yield (
                f"no later step can use the output ?{output.name}, because the effect does not say what it is; "
                f"state a fact about it, such as `?Object.Attribute = ?{output.name}`"
            )
    for name in undetermined_inputs(service):
        yield (
            f"no plan can contain this service, because nothing says which value its input ?{name} has; "
            f"mention ?{name} in the precondition, such as `?Object.Attribute = ?{name}`, or in the effect"
        )


def undetermined_inputs(service: ServiceType) -> list[str]:
    """The inputs that are numbers or texts, and of which neither the conditions nor the effect say anything."""
    said = {*_mentioned(service.effect), *_mentioned(service.precondition), *_mentioned(service.invariant)}
    return [parameter.name for parameter in service.inputs if parameter.type in ("number", "text") and parameter.name not in said]


def _mentioned(formula: str | None) -> Iterable[str]:
    """The names of the variables of a formula; none if it cannot be parsed, which others report."""
    try:
        return variables(parse(formula)) if formula is not None else ()
    except FormulaError:
        return ()


def _calculates(part: Comparison) -> bool:
    """Whether the part assigns what it reads: `?A.Charge = ?A.Charge - 5`."""
    for target, source in ((part.left, part.right), (part.right, part.left)):
        if isinstance(target, Attribute) and isinstance(source, Arithmetic):
            return target in terms(source)
    return False
