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


def jar_lab(*objects: str) -> str:
    """Return a map of a room of 8 m by 6 m with a jar on a table and these objects, in YAML."""
    further_objects = "\n".join(f"  {object}" for object in objects)
    return f"""{building("Lab", 8, 6, "")}
  Table1: {{type: Table, at: [1, 4, 0], Shape: {{Form: Box, Width: 0.6, Depth: 1, Height: 0.7}}}}
  Jar1: {{type: Jar, at: [1.15, 4, 0.7]}}
{further_objects}
facts:
  - Jar1 isOn Table1
"""


DELIVERY_LAB = jar_lab(
    "Table2: {type: Table, at: [4, 4.5, 0], Shape: {Form: Box, Width: 0.6, Depth: 1, Height: 0.7}}",
    "Dock1: {type: Place, at: [5, 2, 0]}",
    "Robot1: {type: PioneerP3DX, at: [2.5, 3, 0], Speed: 0.8}",
)
"""Where Robot1 can bring the jar to another table, and drive to a dock."""


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
