"""One simulated robot: its activity, the control of its base and arm in each control period, and the space that it claims.

Routines are generators that yield once per control period: those for driving are in `driving.py`, those for gripping and placing in
`handling.py`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator

from somrs.devices.simulator.battery import PER_ARM_SECOND, PER_METRE, PER_RADIAN, Battery
from somrs.devices.simulator.link.commands import MUTING, Fault, RobotState
from somrs.devices.simulator.motion.passages import AutomaticDoor, Lift
from somrs.devices.simulator.motion.road_user import RoadUser
from somrs.devices.simulator.motion.traffic import GAP, Capsule
from somrs.devices.simulator.world.joints import Joints
from somrs.devices.simulator.world.scene import Scene
from somrs.protocol.messages.traffic import Mobility
from somrs.space.dimensions import Dimensions, dimensions_of
from somrs.space.doorways import doors_between
from somrs.space.free_space import FreeSpace
from somrs.space.solids import Point, Solid
from somrs.space.squares import Squares, box_around
from somrs.space.zones import Zones
from somrs.traffic.roadmap import RobotKind

ACCELERATION = 0.8
"""Acceleration of the base, m/s²."""
BRAKING = 1.2
"""Deceleration that claims assume, m/s²; the servos can brake harder."""
COMFORTABLE = 0.6 * BRAKING
"""Deceleration with which it comes to a place or into a slow zone, m/s²."""
TURNING, TURNING_UP = 1.6, 4.0
"""Turning speed and turning acceleration of the base, rad/s and rad/s²."""
RATES = {"turret": 1.3, "lift": 0.4, "reach": 0.4, "wrist": 2.5, "left": 0.08, "right": 0.08}
"""Speeds at which the set points of the arm's joints approach their targets, rad/s and m/s."""
ARM = 0.11
"""Half the width of the space that the arm needs while it works, m."""
STOREY = 1.5
"""Difference in height below which robots are on the same floor, m."""
CELL = 1.5
"""Size of the squares by which robots near a place are found, m."""
STANDING = 0.01
"""Speed below which the base counts as standing, m/s and rad/s."""
_TOLERANCES = {"turret": 0.01, "lift": 0.006, "reach": 0.004, "wrist": 0.05, "left": 0.006, "right": 0.006}

Routine = Generator[None, None, None]


class GivenUp(Exception):
    """A routine cannot continue. `reason` is a reason of `CommandGivenUp`. Not raised to callers of the simulation."""

    def __init__(self, reason: str, description: str) -> None:
        self.reason, self.description = reason, description
        super().__init__(reason, description)

    @property
    def leaves_other_places(self) -> bool:
        """Whether the robot only did not get to one place: from another one, it may be able to go on."""
        return self.reason in ("blocked", "unreachable")


def wrap(angle: float) -> float:
    """The equivalent angle in (-pi, pi]."""
    return math.atan2(math.sin(angle), math.cos(angle))


def nearest_half_turn(angle: float) -> float:
    """The equivalent wrist angle nearest to zero: the fingers are symmetric, so half turns make no difference."""
    return (angle + math.pi / 2) % math.pi - math.pi / 2


class Robot:
    """A robot in the scene. `fleet`: all robots by name, including this robot. `free_space`: that of the floor of a height."""

    def __init__(self, solid: Solid, scene: Scene, free_space: Callable[[float], FreeSpace], fleet: Fleet, road: RoadUser) -> None:
        self.solid, self.scene, self.fleet, self.road = solid, scene, fleet, road
        self._free_space_at = free_space
        self.level = solid.z
        """The height of the floor on which it stands or, in a lift, to which it is taken, m."""
        self.name = solid.name
        self.size: Dimensions = dimensions_of(solid)
        self.faults: set[Fault] = set()
        self.paused = False
        """Whether an operator has stopped it."""
        self.activity: str | None = None
        self.plan: list[Point] = []
        """The remaining path while it drives."""
        self.arm_claim: Capsule | None = None
        self.weighed: dict[str, float] = {}
        """The weights that the arm has measured during the current command, kg, by the names of the things."""
        self.is_outside = False
        """Whether it takes part in traffic by messages of a program of its own."""
        self.is_obstructed = False
        """Whether something stands in the way of the motion that it was told."""
        self.awaited_door: AutomaticDoor | None = None
        """The door in front of which it stands until it is open."""
        self.battery = Battery(solid.charge, scene.time)
        self.speed, self._turning, self.heading = 0.0, 0.0, (1.0, 0.0)
        self._moved = False
        self._targets: dict[str, float] = {joint: self.joints[joint] for joint in RATES} if self.size.gripper else {}

    @property
    def free_space(self) -> FreeSpace:
        """Plans its paths on its floor."""
        return self._free_space_at(self.level)

    @property
    def kind(self) -> RobotKind:
        """For which places of the roadmap it is."""
        return RobotKind(self.size.radius, self.solid.graph)

    @property
    def period(self) -> float:
        """The control period, s."""
        return self.scene.period

    @property
    def sweep_claim(self) -> Capsule | None:
        """The space through which a door moves that this robot opens or closes."""
        return self.fleet.sweeps.get(self.name)

    @property
    def joints(self) -> Joints:
        return self.scene.joints[self.name]

    @property
    def holding(self) -> str | None:
        return self.scene.hands.held.get(self.name)

    @property
    def possible_faults(self) -> tuple[Fault, ...]:
        """The faults that it can have: without an arm, none of the gripper."""
        return tuple(fault for fault in Fault if fault is not Fault.GRIPPER or self.size.gripper)

    @property
    def mobile(self) -> bool:
        """Whether its drive works, and may."""
        return not (self.paused or self.is_mute or Fault.DRIVE in self.faults)

    @property
    def is_mute(self) -> bool:
        """Whether a fault keeps it from sending anything; then it stands, too."""
        return not MUTING.isdisjoint(self.faults)

    @property
    def hindrance(self) -> str | None:
        """What keeps it from going on, and will pass without it: the lift in which it stands moves nobody now."""
        passage = self.awaited_door or self.fleet.lifts.get(self.road.zone or "")
        return passage.hindrance if passage is not None and self.activity is not None else None

    @property
    def stands(self) -> bool:
        return max(map(abs, self.joints.speed())) < STANDING

    def pose(self) -> tuple[float, float, float]:
        return self.joints.pose()

    def state(self) -> RobotState:
        x, y, yaw = self.pose()
        faults = tuple(sorted(self.faults))
        self.battery.pass_time(self.scene.time)  # no period has ended while everything rested
        return RobotState(
            time=self.scene.time,
            x=x,
            y=y,
            yaw=yaw,
            z=self.solid.z,
            holding=self.holding,
            activity=self.activity,
            faults=faults,
            charge=self.battery.charge,
            hindrance=self.hindrance,
            obstructed=self.is_obstructed,
        )

    # The base

    def begin_period(self) -> None:
        self._moved = False

    def end_period(self) -> None:
        """Drive the base. Without a call of `move` in this period, it stops."""
        if not self._moved:
            self.speed = self._turning = 0.0
        self.battery.pass_time(self.scene.time)
        self.battery.use((PER_METRE * self.speed + PER_RADIAN * abs(self._turning)) * self.period)
        self.joints.drive("x", self.speed * self.heading[0])
        self.joints.drive("y", self.speed * self.heading[1])
        self.joints.drive("yaw", self._turning)

    def move(self, direction: Point, speed: float, turning: float) -> Robot | None:
        """Move the base in this period, as close to the requested motion as the drive and the claims of other robots allow.

        Returns the robot for which the speed was reduced, if any.
        """
        self._moved = True
        step = TURNING_UP * self.period
        turning = max(-TURNING, min(TURNING, turning))
        self._turning = max(self._turning - step, min(self._turning + step, turning))
        limit = self.fleet.zones.speed_limit(self.pose()[:2], self.level, direction, COMFORTABLE)
        target_speed = max(0.0, min(speed, self.speed + ACCELERATION * self.period, self.solid.speed, limit))
        target_speed = max(target_speed, self.speed - BRAKING * self.period)
        obstacle: Robot | None = None
        for share in (1.0, 0.8, 0.6, 0.4, 0.2, 0.0):
            blocker = self._find_blocker(self.base_claim(direction, target_speed * share))
            if blocker is None:
                self.speed, self.heading = target_speed * share, direction
                break
            obstacle = blocker
        else:
            self.speed = 0.0
        return obstacle

    def base_claim(self, direction: Point | None = None, speed: float | None = None) -> Capsule:
        """The space that the base needs to stop from this motion; by default from the current motion."""
        x, y, _ = self.pose()
        direction, speed = direction or self.heading, self.speed if speed is None else speed
        way = self._braking_way(speed)
        return Capsule((x, y), (x + way * direction[0], y + way * direction[1]), self.size.radius)

    def _braking_way(self, speed: float) -> float:
        return speed * speed / (2 * BRAKING) + 2 * speed * self.period

    @property
    def longest_claim(self) -> float:
        """The largest distance from the middle of the base at which the base or the arm claims space, m."""
        return max(self.size.radius + self._braking_way(self.solid.speed), self.size.farthest + ARM if self.size.gripper else 0.0)

    def claims(self) -> list[Capsule]:
        """The space that this robot claims: for its base, for its arm while that is extended, and for a door that it moves."""
        return [self.base_claim(), *(claim for claim in (self.arm_claim, self.sweep_claim) if claim is not None)]

    def other_robots(self) -> list[Robot]:
        """The other robots on the same floor."""
        return [r for r in self.fleet.values() if r is not self and abs(r.solid.z - self.solid.z) < STOREY]

    def staying_robots(self) -> list[Robot]:
        """The other robots on the same floor that stay where they are."""
        return [r for r in self.other_robots() if r.stays]

    @property
    def stays(self) -> bool:
        """Whether it makes no room now: because it works, cannot drive, or takes no part in traffic."""
        if self.is_outside:
            return not self.mobile or self.activity not in (None, "DriveAlong", "Velocity")
        return not (self.mobile and self.road.takes_part and self.road.mobility is Mobility.FREE)

    def _find_blocker(self, wanted_claim: Capsule) -> Robot | None:
        """A robot whose claim overlaps the wanted claim, or None. Standing still and moving away are always allowed."""
        reach = math.dist(wanted_claim.start, wanted_claim.end) + wanted_claim.radius + GAP
        for other_robot in self.fleet.near(self, reach):
            for claim in other_robot.claims():
                if wanted_claim.gap(claim) < GAP and not _leads_away(wanted_claim, claim):
                    return other_robot
        return None

    # The arm

    def hand(self) -> Point:
        """The position of the hand on the map."""
        x, y, yaw = self.pose()
        angle, reach = yaw + self.joints["turret"], self.joints["reach"]
        return x + reach * math.cos(angle), y + reach * math.sin(angle)

    def aim(self, spot: Point) -> tuple[float, float]:
        """The turret's angle and the boom's reach that bring the hand above a spot."""
        x, y, yaw = self.pose()
        return wrap(math.atan2(spot[1] - y, spot[0] - x) - yaw), math.dist((x, y), spot)

    def lead(self, joint: str, target: float) -> bool:
        """Move the set point of a joint towards its target for one period. Returns whether it has reached the target."""
        step = RATES[joint] * self.period
        if joint in ("left", "right"):
            self.need_gripper()
        current = self._targets[joint]
        self._targets[joint] = current + max(-step, min(step, target - current))
        if self._targets[joint] != current:
            self.battery.use(PER_ARM_SECOND * self.period)
        self.joints.drive(joint, self._targets[joint])
        return abs(target - self._targets[joint]) < 1e-9

    def lead_turret(self, target: float) -> None:
        """Move the set point of the turret for one period, by the shorter way."""
        self.lead("turret", self._targets["turret"] + wrap(target - self._targets["turret"]))

    def hold_joint(self, joint: str) -> None:
        """Hold a joint at its current position."""
        self._targets[joint] = self.joints[joint]
        self.joints.drive(joint, self._targets[joint])

    def arm(self, **targets: float) -> Routine:
        """Bring joints of the arm to their targets simultaneously."""
        if "turret" in targets:
            targets["turret"] = self._targets["turret"] + wrap(targets["turret"] - self._targets["turret"])
        settling = 0
        while True:
            completed = [self.lead(joint, target) for joint, target in targets.items()]
            yield
            if all(completed):
                settling += 1
                if settling > 75 or all(abs(self.joints[joint] - target) < _TOLERANCES[joint] for joint, target in targets.items()):
                    return

    def need_gripper(self) -> None:
        if Fault.GRIPPER in self.faults:
            raise GivenUp("gripper-stuck", f"the gripper of {self.name} does not move")

    def need_drive(self) -> None:
        if Fault.DRIVE in self.faults:
            raise GivenUp("drive-dead", f"the drive of {self.name} is dead")
        if self.battery.charge <= 0:
            raise GivenUp("battery-empty", f"the battery of {self.name} is empty")

    @property
    def arm_out(self) -> bool:
        """Whether the hand is not above the base."""
        return self.size.gripper and self.joints["reach"] > self.size.drawn_in + 0.02


class Fleet(dict[str, Robot]):
    """All robots by name, and which of them are near each other.

    `sweeps`: the space through which a door moves, by the robot that opens or closes it. `lifts` and `doors`, which are automatic: by name.
    `zones`: those that operators have drawn.
    """

    def __init__(self) -> None:
        super().__init__()
        self.sweeps: dict[str, Capsule] = {}
        self.lifts: dict[str, Lift] = {}
        self.doors: dict[str, AutomaticDoor] = {}
        self.zones = Zones()
        self.levels: set[float] = set()
        """The heights of the floors on which robots are, or to which they are on their way, as the roadmap has them."""
        self._squares = Squares[Robot](CELL)
        self._reach = 0.0
        """How far a claim of a robot can be from the middle of its base, m."""

    def locate(self) -> None:
        """Find out where the robots are. Call it once per control period: within a period, robots decide how they move, and do not yet."""
        self._squares = Squares[Robot](CELL)
        for robot in self.values():
            self._squares.add(robot, box_around(robot.pose()[:2], 0.0))
        self._reach = max((robot.longest_claim for robot in self.values()), default=0.0)

    def doors_between(self, robot: Robot, start: Point, end: Point) -> list[AutomaticDoor]:
        """The automatic doors through which a robot drives on a straight line."""
        solids = (door.solid for door in self.doors.values())
        return [self.doors[name] for name in doors_between(solids, robot.level, start, end, robot.size.radius)]

    def near(self, robot: Robot, distance: float, point: Point | None = None) -> Iterator[Robot]:
        """The other robots on this robot's floor that may claim something at most `distance` away from a point; by default, from it."""
        level, box = robot.solid.z, box_around(point or robot.pose()[:2], distance + self._reach)
        for near_robot in self._squares.near(box):
            if near_robot is not robot and near_robot.name not in self.sweeps and abs(near_robot.solid.z - level) < STOREY:
                yield near_robot
        for name in self.sweeps:  # doors are as large as they are, and few are moved at a time
            if name != robot.name and abs(self[name].solid.z - level) < STOREY:
                yield self[name]


def _leads_away(wanted_claim: Capsule, claim: Capsule) -> bool:
    """Whether the wanted claim begins too close to the other claim and leads away from it. Both are convex, so it does not come back."""
    way = math.dist(wanted_claim.start, wanted_claim.end)
    if way == 0:
        return True
    share = min(1.0, 0.01 / way)
    ahead = tuple(start + share * (end - start) for start, end in zip(wanted_claim.start, wanted_claim.end, strict=True))
    now = Capsule(wanted_claim.start, wanted_claim.start, wanted_claim.radius).gap(claim)
    return now < GAP and Capsule((ahead[0], ahead[1]), (ahead[0], ahead[1]), wanted_claim.radius).gap(claim) >= now


def stand(robot: Robot) -> Routine:
    """Wait until the base stands: it rolls on for some centimetres."""
    for _ in range(100):
        yield
        if robot.stands:
            return


def wait(robot: Robot, seconds: float) -> Routine:
    """Let time pass."""
    for _ in range(max(1, round(seconds / robot.period))):
        yield
