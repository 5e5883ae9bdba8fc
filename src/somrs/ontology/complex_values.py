"""Whether the values of a complex attribute conform to a complex attribute (paper: "*Shape* is a *complex attribute* consisting of its
own attributes and their constraints", and the constraint "Shape is CuboidFurnitureLegShape")."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from msgspec import structs

from somrs.ontology.types import AttributeType, Constraint, Kind, Ontology, Value


def complex_problem(constraint: Constraint, values: Mapping[str, Value], ontology: Ontology) -> str:
    """Why the values at the path of the constraint conform to none of the complex attributes that it names; empty if they do.

    `values`: those of an object, by path, with the defaults of its type. An object without values at the path conforms.
    """
    path = constraint.attribute or ""
    inner_values = {name.removeprefix(f"{path}."): value for name, value in values.items() if name.startswith(f"{path}.")}
    if not inner_values:
        return ""
    problems: list[str] = []
    for name in map(str, constraint.values):
        problem = next(_problems(ontology.attributes[name], inner_values, ontology), "") if name in ontology.attributes else ""
        if not problem:
            return ""
        problems.append(f"{path} is a {name}, and {problem}")
    return "; or ".join(problems)


def inner_constraints(path: str, attribute: AttributeType) -> Iterator[Constraint]:
    """The constraints of a complex attribute, with the paths that they have in an object whose attribute at `path` it is."""
    for constraint in attribute.constraints:
        yield structs.replace(constraint, attribute=f"{path}.{constraint.attribute}")


def _problems(attribute: AttributeType, values: Mapping[str, Value], ontology: Ontology) -> Iterator[str]:
    paths = dict(inner_paths(attribute, ontology))
    for path in values:
        if path not in paths:
            yield f"a {attribute.name} has no {path}; it has {', '.join(attribute.attributes)}"
    for path, inner in paths.items():
        if inner.kind is not Kind.COMPLEX and path not in values:
            yield f"a {attribute.name} has a {path}, which is not given"
    for path, inner in {"": attribute, **paths}.items():
        for constraint in inner_constraints(path, inner) if path else attribute.constraints:
            value = values.get(constraint.attribute or "")
            if problem := limit_problem(constraint, value) if value is not None else complex_problem(constraint, values, ontology):
                yield problem


def inner_paths(attribute: AttributeType, ontology: Ontology, prefix: str = "") -> Iterator[tuple[str, AttributeType]]:
    """The attributes in a complex attribute, at any depth, by their paths below it."""
    for name in attribute.attributes if prefix.count(".") < 8 else ():
        inner = ontology.attributes.get(name)
        if inner is not None:
            yield f"{prefix}{name}", inner
            yield from inner_paths(inner, ontology, f"{prefix}{name}.")


def limit_problem(constraint: Constraint, value: Value) -> str:
    """Why the value is not within the limits of the constraint; empty if it is."""
    if not isinstance(value, bool | str):
        if constraint.minimum is not None and value < constraint.minimum:
            return f"{constraint.attribute} is at least {constraint.minimum:g}, not {value:g}"
        if constraint.maximum is not None and value > constraint.maximum:
            return f"{constraint.attribute} is at most {constraint.maximum:g}, not {value:g}"
    if constraint.values and value not in constraint.values:
        return f"{constraint.attribute} is one of {', '.join(map(str, constraint.values))}, not {value}"
    return ""
