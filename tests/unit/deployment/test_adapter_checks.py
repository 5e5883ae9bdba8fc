"""Every mistake in the settings of adapters is named before anything is started, with its line and what to do."""

from __future__ import annotations

from pathlib import Path
from textwrap import dedent

import pytest

from somrs.cli.commands import check
from somrs.deployment.site_adapters import SiteAdapters
from somrs.errors import ModelError
from tests.support.paths import ROOT

SITE = """\
objects:
  Hall: {type: Building, parts: {Ground: {type: Storey, parts: \
{Floor1: {type: Floor, at: [5, 5, 0], Shape: {Form: Box, Width: 9, Depth: 9, Height: 0.1}}, Pioneer1: {type: PioneerP3DX, at: [3, 3, 0]}}}}}
  Lifter1: {type: MobileManipulator, at: [1, 1, 0], Shape: {Form: Cylinder, Radius: 0.5, Height: 1}}
adapters:
"""


def problems(folder: Path, adapters: str) -> list[str]:
    """What is said about a site with these adapters, without the name of its file."""
    file = folder / "hall.yaml"
    file.write_text(SITE + adapters)
    (folder / "robot.yaml").write_text("attributes: {Sped: {topic: odom, type: nav_msgs/msg/Odometry}}\n")
    (folder / "things.yaml").write_text("things: {Lifter1: {type: Light, attributes: {On: {topic: a}}}}\n")
    site = SiteAdapters([file], folder, "127.0.0.1", {}, with_arcos=False)
    try:
        site.check(is_fresh=True)
    except ModelError as error:
        return [f"{problem.line}: {problem.subject}: {problem.message}".replace(f"{folder}/", "") for problem in error.problems]
    return []


def vehicle(serial: str = 'serialNumber: "1"', name: str = "Lifter1", broker: str = "broker: mqtt://b", more: str = "") -> str:
    return f"  vda5050:\n    {broker}\n    vehicles:\n      {name}: {{manufacturer: ACME, {serial}}}\n{more}"


MISTAKES = {
    "a setting is misspelt": (
        vehicle(broker="brokr: mqtt://b"),
        ["6: adapters.vda5050.brokr: unknown key brokr; did you mean broker?"],
    ),
    "the broker is missing": (
        vehicle(broker="namedOnly: true"),
        ["5: adapters.vda5050.broker: broker is missing; write broker: mqtt://HOST:PORT or own or bus"],
    ),
    "the address of the broker is none": (
        vehicle(broker="broker: mqtt://b:1883O"),
        ["6: adapters.vda5050.broker: 'mqtt://b:1883O' has no valid port: write mqtt://HOST:PORT, or mqtts://USER@HOST:PORT with TLS"],
    ),
    "a setting of a vehicle is misspelt": (
        vehicle('serialnumber: "1"'),
        ["8: adapters.vda5050.vehicles.Lifter1.serialnumber: unknown key serialnumber; did you mean serialNumber?"],
    ),
    "a serial number is not quoted": (
        vehicle("serialNumber: 0001"),
        ["8: adapters.vda5050.vehicles.Lifter1.serialNumber: serialNumber should be a text, not 1; write it in quotes"],
    ),
    "a vehicle is not on the map": (
        vehicle(name="Liftr1"),
        ["8: adapters.vda5050.vehicles.Liftr1: there is no Liftr1 on the map; did you mean Lifter1?"],
    ),
    "several are wrong": (
        vehicle(
            more="    namedOnly: yess\n    stationTyp: rack\n    interface: uagv/v2\n    maps: {hall: {level: ground, turned: 90 deg}}\n"
        ),
        [
            "9: adapters.vda5050.namedOnly: namedOnly should be true or false, not 'yess'",
            "10: adapters.vda5050.stationTyp: unknown key stationTyp; did you mean stationType or stationTypes?",
            "11: adapters.vda5050.interface: 'uagv/v2' ends with the version, which follows by itself: leave it out",
            "12: adapters.vda5050.maps.hall.level: level should be a number in m, not 'ground'",
            "12: adapters.vda5050.maps.hall.turned: turned should be a number in degrees, not '90 deg'",
        ],
    ),
    "a vehicle is no robot on the map": (
        vehicle(name="Floor1"),
        ["8: adapters.vda5050.vehicles.Floor1: Floor1 is a Floor on the map, and no MobileRobot; correct the name, or the type on the map"],
    ),
    "a floor is not on the map": (
        vehicle(more="    maps: {hall: {level: 4}}\n"),
        ["9: adapters.vda5050.maps.hall.level: there is no floor at 4 m; there are floors at 0 m"],
    ),
    "a robot is served twice": (
        vehicle() + "  arcos: {robots: {Lifter1: {port: /dev/ttyUSB0, start: [50, 5, 0]}}}\n",
        [
            "9: adapters.arcos.robots.Lifter1: Lifter1 is served by the adapter vda5050, too; name it in one of them",
            "9: adapters.arcos.robots.Lifter1.start: (50, 5) is 40 m beside all floors of the map; give metres on the map",
        ],
    ),
    "files and programs are not there": (
        "  ros2:\n    python: /none/python\n    setup: none.bash\n    robots:\n      Lifter1: {binding: none.yaml}\n",
        [
            "6: adapters.ros2.python: there is no /none/python; name the Python of your ROS, or its `setup` file",
            "7: adapters.ros2.setup: there is no file none.bash; name the one of your ROS, such as /opt/ros/jazzy/setup.bash",
            "9: adapters.ros2.robots.Lifter1.binding: there is no file none.yaml; correct the path, which is relative to the site file",
        ],
    ),
    "an attribute of a robot is misspelt": (
        "  ros2: {robots: {Lifter1: {binding: robot.yaml}}}\n",
        [
            "5: adapters.ros2.robots.Lifter1.binding: robot.yaml binds attributes.Sped, which Lifter1, a MobileManipulator, does not have; "
            "did you mean Speed or Shape or Paused?"
        ],
    ),
    "a thing is a robot on the map": (
        "  things: {broker: mqtt://b, mappings: [things.yaml]}\n",
        [
            "5: adapters.things.mappings: Lifter1: is a MobileManipulator on the map, and a Light here; name another object, or correct "
            "one of the types"
        ],
    ),
    "files and connections of things are not there": (
        "  things: {broker: mqtt://b, gateway: my gateway, mappings: [none.yaml], descriptions: [none.json]}\n",
        [
            "5: adapters.things.mappings.0: there is no file none.yaml; correct the name, which is relative to the site file",
            "5: adapters.things.descriptions.0: there is no file none.json; correct the name, which is relative to the site file",
        ],
    ),
    "settings of things do not fit one another": (
        "  things: {broker: mqtt://b, gateway: my gateway, home_assistant: [{connection: brokr}], simulated: {Lift9: {G: 0}}}\n",
        [
            "5: adapters.things.gateway: 'my gateway' is not a name of an object: write a letter, and then letters, digits, _ or -",
            "5: adapters.things.simulated.Lift9: no mapping has Lift9 with a session; correct the name",
            "5: adapters.things.home_assistant.0.connection: brokr is no connection to an MQTT broker; did you mean broker?",
        ],
    ),
    "there are two places of one broker": (
        vehicle(broker="broker: own 127.0.0.1:1883") + "  things: {broker: own 127.0.0.1}\n",
        ["9: adapters.things.broker: '127.0.0.1' is no address: write HOST:PORT, such as 10.0.0.7:8883"],
    ),
    "there is no such adapter": ("  vda550: {broker: own}\n", ["5: adapters.vda550: there is no adapter vda550; did you mean vda5050?"]),
    "of another adapter": (
        "  arcos: {robots: {Lifter1: {port: 'tcp://b', speed: 0, baud: fast}}}\n",
        [
            "5: adapters.arcos.robots.Lifter1.baud: baud should be a whole number, not 'fast'",
            "5: adapters.arcos.robots.Lifter1.speed: speed should be more than 0 m/s, not 0",
            "5: adapters.arcos.robots.Lifter1.port: 'tcp://b' has no address: write tcp://HOST:PORT, with the number of a port, "
            "such as tcp://10.0.0.7:8101",
        ],
    ),
    "things": ("  things: {mapings: [x.yaml]}\n", ["5: adapters.things.mapings: unknown key mapings; did you mean mappings?"]),
}


@pytest.mark.parametrize(("adapters", "expected"), MISTAKES.values(), ids=MISTAKES.keys())
def test_each_mistake_has_its_line(tmp_path: Path, adapters: str, expected: list[str]) -> None:
    assert problems(tmp_path, adapters) == expected


@pytest.mark.parametrize("broker", ["own", "bus", "mqtt://b"])
def test_settings_without_a_mistake(tmp_path: Path, broker: str) -> None:
    assert (
        problems(tmp_path, vehicle(broker=f"broker: {broker}") + "  arcos: {robots: {Pioneer1: {port: /dev/ttyUSB0, baud: 9600}}}\n") == []
    )


def test_somrs_check_says_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    problems(tmp_path, vehicle(name="Liftr1"))
    assert check([tmp_path / "hall.yaml"], json=False) == 1
    assert "hall.yaml:8: adapters.vda5050.vehicles.Liftr1: there is no Liftr1 on the map" in capsys.readouterr().out


def test_the_command_line_may_name_the_broker(tmp_path: Path) -> None:
    file = tmp_path / "hall.yaml"
    file.write_text(SITE + vehicle(broker="namedOnly: true"))
    chosen = {"vda5050": {"broker": "mqtt://b"}}
    SiteAdapters([file], tmp_path, "127.0.0.1", chosen, with_arcos=False).check(is_fresh=True)


def test_the_map_of_an_earlier_run_may_have_what_the_files_have_not(tmp_path: Path) -> None:
    file = tmp_path / "hall.yaml"
    file.write_text(SITE + vehicle(name="Added1"))
    SiteAdapters([file], tmp_path, "127.0.0.1", {}, with_arcos=False).check(is_fresh=False)


def test_the_whole_site_of_the_page_about_vehicles_has_no_mistake(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = (ROOT / "docs" / "how-to" / "connect-vda5050-vehicles.md").read_text()
    (example,) = [block for block in page.split("```yaml\n")[1:] if "objects:" in block.partition("```")[0]]
    (tmp_path / "hall.yaml").write_text(dedent(example.partition("    ```")[0]))
    assert check([tmp_path / "hall.yaml"], json=False) == 0, capsys.readouterr().out
