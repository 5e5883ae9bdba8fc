"""The beginning of test sites."""


def building(map: str, width: int, depth: int, *parts: str) -> str:
    """Return a map with a building of one storey, in YAML; more objects may follow. `parts`: of the storey, besides its floor."""
    shape = f"{{Form: Box, Width: {width}, Depth: {depth}, Height: 0.1}}"
    floor = f"Floor1: {{type: Floor, at: [{width // 2}, {depth // 2}, -0.1], Shape: {shape}}}"
    storey = "\n".join(f"          {part}" for part in (floor, *parts))
    return f"""
map: {map}
objects:
  Building1:
    type: Building
    parts:
      Storey1:
        type: Storey
        parts:
{storey}"""


def wide_building(map: str) -> str:
    """Return a map with a building of one storey, 20 m by 20 m about the origin, in YAML; more parts and objects may follow."""
    return f"""
map: {map}
objects:
  Building001:
    type: Building
    parts:
      Storey001:
        type: Storey
        parts:
          Floor001: {{type: Floor, at: [0, 0, -0.1], Shape: {{Form: Box, Width: 20, Depth: 20, Height: 0.1}}}}"""
