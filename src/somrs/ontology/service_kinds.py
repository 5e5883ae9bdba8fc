"""What the effect of a service can say, by its kind (paper, "Services"): only physical services change something."""

from __future__ import annotations

from collections.abc import Iterator

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


def _calculates(part: Comparison) -> bool:
    """Whether the part assigns what it reads: `?A.Charge = ?A.Charge - 5`."""
    for target, source in ((part.left, part.right), (part.right, part.left)):
        if isinstance(target, Attribute) and isinstance(source, Arithmetic):
            return target in terms(source)
    return False
