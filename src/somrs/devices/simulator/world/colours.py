"""The colours of objects, in pictures and on the map: their own, or the typical colour of their type or role."""

from __future__ import annotations

from somrs.space.solids import Role, Solid

Colour = tuple[float, float, float, float]

_COLOURS: dict[str, Colour] = {
    "Black": (0.10, 0.10, 0.11, 1),
    "White": (0.93, 0.93, 0.91, 1),
    "Grey": (0.60, 0.62, 0.64, 1),
    "Red": (0.80, 0.13, 0.12, 1),
    "Orange": (0.94, 0.48, 0.10, 1),
    "Yellow": (0.95, 0.77, 0.15, 1),
    "Green": (0.20, 0.58, 0.28, 1),
    "Blue": (0.12, 0.36, 0.74, 1),
    "Brown": (0.60, 0.42, 0.26, 1),
}
# The colours of types, for objects whose colour the map does not state.
_TYPICAL: dict[str, Colour] = {
    "Table": (0.72, 0.55, 0.37, 1),
    "Cupboard": (0.55, 0.40, 0.28, 1),
    "Shelf": (0.70, 0.71, 0.72, 1),
    "Platform": (0.88, 0.70, 0.16, 1),
    "Scale": (0.56, 0.60, 0.64, 1),
    "Chair": (0.20, 0.38, 0.58, 1),
    "Bin": (0.35, 0.37, 0.38, 1),
    "Plant": (0.25, 0.50, 0.22, 1),
    "Jar": (0.80, 0.13, 0.12, 1),
    "Bottle": (0.16, 0.45, 0.30, 1),
    "Carton": (0.74, 0.58, 0.40, 1),
    "Charger": (0.20, 0.62, 0.35, 0.55),
    "Window": (0.62, 0.78, 0.88, 0.35),
    "Door": (0.58, 0.42, 0.28, 1),
    "Lift": (0.55, 0.68, 0.76, 0.3),
}
_BY_ROLE: dict[Role, Colour] = {
    Role.FLOOR: (0.82, 0.81, 0.78, 1),
    Role.WALL: (0.92, 0.91, 0.88, 1),
    Role.SUPPORT: (0.65, 0.55, 0.45, 1),
    Role.ROBOT: (0.72, 0.12, 0.11, 1),
    Role.MARK: (0.20, 0.45, 0.75, 0.35),
    Role.CAMERA: (0.85, 0.86, 0.88, 1),
}
METAL: Colour = (0.35, 0.36, 0.38, 1)


def colour_of(solid: Solid) -> Colour:
    """The object's own colour, or the typical colour of its type or role."""
    typical = _TYPICAL.get(solid.type) or _BY_ROLE.get(solid.role, (0.62, 0.62, 0.60, 1))
    if solid.color in _COLOURS:
        own_colour = _COLOURS[solid.color]
        if solid.role is Role.FLOOR:  # floors get a light tint of their colour
            own_colour = (0.45 + 0.55 * own_colour[0], 0.45 + 0.55 * own_colour[1], 0.45 + 0.55 * own_colour[2], 1)
        return (*own_colour[:3], typical[3])
    return typical


def shade(colour: Colour, factor: float) -> Colour:
    return (min(1.0, colour[0] * factor), min(1.0, colour[1] * factor), min(1.0, colour[2] * factor), colour[3])
