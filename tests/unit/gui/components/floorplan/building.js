// A small building for the tests of the floor plan: two storeys, a table with a jar, a robot, and a shelf in it.

const type = (name, parent, defaults = {}) => ({ name, parent, defaults });

export const DEFINITIONS = {
  types: [
    type("Object", null), type("AbstractObject", "Object"), type("Storey", "AbstractObject"), type("Space", "AbstractObject"),
    type("PhysicalObject", "Object"), type("BuildingElement", "PhysicalObject"), type("Wall", "BuildingElement"), type("Floor", "BuildingElement"),
    type("Door", "BuildingElement"), type("Support", "PhysicalObject"), type("Table", "Support", { "Shape.Form": "Box", "Shape.Width": 1, "Shape.Depth": 2, "Shape.Height": 0.75 }),
    type("Graspable", "PhysicalObject"), type("Jar", "Graspable", { "Shape.Form": "Cylinder", "Shape.Radius": 0.05, "Shape.Height": 0.1, Color: "Red" }),
    type("MobileRobot", "PhysicalObject", { "Shape.Form": "Cylinder", "Shape.Radius": 0.3 }), type("Person", "PhysicalObject"),
    type("Zone", "PhysicalObject"), type("NoGoZone", "Zone", { "Shape.Form": "Polygon" }), type("Waypoint", "PhysicalObject"), type("Lane", "AbstractObject"),
  ],
  relations: [{ name: "isOn" }, { name: "isPartOf" }],
};

export const object = (name, kind, x, y, more = {}) => ({ name, type: kind, values: { ...(x === undefined ? {} : { PositionX: x, PositionY: y }), ...more } });
export const fact = (relation, ...names) => ({ relation, arguments: names });
const box = (width, depth) => ({ "Shape.Form": "Box", "Shape.Width": width, "Shape.Depth": depth });

export function building() {
  return {
    version: 7,
    objects: [
      object("Upper", "Storey", undefined, undefined, { Elevation: 3, Label: "First floor" }), object("Ground", "Storey", undefined, undefined, { Elevation: 0 }),
      object("Hall", "Space", undefined, undefined, { Label: "The hall" }),
      object("Floor0", "Floor", 5, 5, box(10, 10)), object("Floor1", "Floor", 5, 5, { ...box(10, 10), PositionZ: 3 }),
      object("Wall001", "Wall", 0, 5, box(0.2, 10)), object("Door001", "Door", 10, 5, { ...box(0.1, 0.9), Open: true }),
      object("Table001", "Table", 2, 3, { PositionZ: 0 }), object("Jar001", "Jar", 2, 3.5, { PositionZ: 0.75 }), object("Jar002", "Jar", 8, 8, { PositionZ: 3 }),
      object("Robot1", "MobileRobot", 6, 6), object("Nowhere", "Jar"), object("Guest", "Person"),
    ],
    facts: [
      fact("isPartOf", "Hall", "Ground"), fact("isPartOf", "Floor0", "Hall"), fact("isPartOf", "Floor1", "Upper"), fact("isOn", "Jar001", "Table001"),
    ],
  };
}
