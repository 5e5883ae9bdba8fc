"""Names that a class of an author takes from its base classes by mistake. Python would not say so, and what the base classes keep there
would be overwritten."""

from __future__ import annotations

import dis
import functools
import inspect
from collections.abc import Collection, Iterator
from types import CodeType, FunctionType

from somrs.errors import DeviceError
from somrs.service_manager.sdk.device import Service

SHIPPED = ("somrs.devices.", "somrs.service_manager.")
"""How the modules of base classes begin."""

STORE = dis.opmap["STORE_ATTR"]

FOR_ALL = frozenset(
    {
        *("type", "types", "values", "situation", "attributes", "capacity", "heartbeat", "valid_for", "lease"),
        *("open", "close", "services", "find_service"),
    }
)
"""What authors of all devices set and override."""


def check_own_names(kind: type, for_authors: Collection[str]) -> None:
    """Check that a class that an author has derived defines and assigns names of its own, besides those `for_authors`.

    Raises DeviceError with the others.
    """
    bases = [base for base in kind.__mro__[:-1] if base.__module__.startswith(SHIPPED)]
    if kind in bases:
        return
    mixins = [base for base in kind.__mro__[1:-1] if base not in bases and not any(issubclass(base, shipped) for shipped in bases)]
    taken = {name: base for base in reversed(bases) for name in _names(base)}
    clashes = sorted({name for own in (kind, *mixins) for name in _names(own) if name in taken and name not in for_authors})
    if clashes:
        owners = ", ".join(f"{name} (of {taken[name].__name__})" for name in clashes)
        raise DeviceError(f"{kind.__name__} uses names that its base classes use for something else: {owners}; rename them")


@functools.cache
def _names(kind: type) -> frozenset[str]:
    """What a class defines, and what its methods assign to attributes of their first argument."""
    defined = {name for name in (*vars(kind), *inspect.get_annotations(kind)) if not name.startswith("__")}
    functions = (function for member in vars(kind).values() for function in _functions(member))
    return frozenset(defined.union(*map(_assigned_by, functions)))


def _functions(member: object) -> Iterator[FunctionType]:
    match member:
        case FunctionType():
            yield member
        case property():
            yield from (part for part in (member.fget, member.fset, member.fdel) if isinstance(part, FunctionType))
        case Service(performs=FunctionType() as performs):
            yield performs


def _assigned_by(function: FunctionType) -> set[str]:
    code = function.__code__
    return set(_assigned(code, code.co_varnames[0])) if code.co_argcount else set()


def _assigned(code: CodeType, first: str) -> Iterator[str]:
    """The attributes of the variable `first` that the code assigns, and the functions in it."""
    loaded: object = None
    instructions = dis.get_instructions(code) if STORE in code.co_code[::2] else ()  # most functions assign none
    for instruction in instructions:
        if instruction.opcode == STORE and loaded == first:
            yield instruction.argval
        loaded = None
        if any(part in instruction.opname for part in ("FAST", "DEREF")):
            # One instruction loads a variable, or, from Python 3.13 on, two: the last one is the object.
            loaded = instruction.argval[-1] if isinstance(instruction.argval, tuple) else instruction.argval
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _assigned(constant, first)
