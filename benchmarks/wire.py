"""Measures SOAP messages beside msgspec's JSON of the same structs and lxml alone on the same bytes: `python benchmarks/wire.py`."""

from __future__ import annotations

import asyncio

import msgspec
from lxml import etree
from timing import side_by_side

from somrs.ontology.objects import Fact, Object
from somrs.protocol.messages import frp, knowledge
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.soap import soap
from somrs.runtime.http import Server
from somrs.runtime.wire import Wire

HEADER = Header(
    sender="http://10.0.0.2:8003/task-manager",
    recipient="http://10.0.0.7:9000/devices/Robot1",
    message_id=message_id("m"),
    reply_to="http://10.0.0.2:8003/task-manager",
)
SESSION = msgspec.structs.replace(HEADER, transaction=message_id("t"), participant="Robot1.TransferObject#s1")
ARRANGE = frp.Arrange(
    service_type="TransferObject",
    inputs={"Object": "Jar002", "Destination": "Platform001"},
    effect="Jar002 isOn Platform001",
    precondition="Jar002 isOn Shelf003",
    latest_finish=1767225900.0,
    reply_by=1767225610.0,
)
MAP_PAGE = knowledge.MapPage(
    objects=tuple(
        Object(name=f"Jar{n}", type="Jar", values={"PositionX": n / 10, "PositionY": 1.0, "PositionZ": 0.8, "Color": "Blue"})
        for n in range(100)
    ),
    facts=tuple(Fact("isOn", (f"Jar{n}", f"Shelf{n // 2}")) for n in range(100)),
    version=7,
    more=True,
)
EXAMPLES: dict[str, tuple[Header, Body]] = {
    "Progress": (SESSION, frp.Progress(fraction=0.5)),
    "Arrange": (SESSION, ARRANGE),
    "MapPage of 100 objects": (HEADER, MAP_PAGE),
}


def compare(name: str, message: Message) -> None:
    """Print the cost of writing and reading the message."""
    document = soap.encode(message)
    assert soap.decode(document) == message
    tree = etree.fromstring(document)
    pair = msgspec.defstruct("Both", [("header", Header), ("body", type(message.body))])(header=message.header, body=message.body)
    encoder, decoder = msgspec.json.Encoder(), msgspec.json.Decoder(type(pair))
    json = encoder.encode(pair)
    assert decoder.decode(json) == pair
    writing = {
        "lxml: the tree to bytes": lambda: etree.tostring(tree, encoding="utf-8", xml_declaration=True),
        "somrs.protocol.soap.soap.encode": lambda: soap.encode(message),
        "msgspec.json of the same structs": lambda: encoder.encode(pair),
    }
    reading = {
        "lxml: the bytes to a tree": lambda: etree.fromstring(document),
        "somrs.protocol.soap.soap.decode": lambda: soap.decode(document),
        "msgspec.json of the same structs": lambda: decoder.decode(json),
    }
    print(f"\n{name}: {len(document)} bytes, and {len(json)} in JSON", end="")
    side_by_side(f"writing {name}", writing)
    side_by_side(f"reading {name}", reading)


def over_http(message: Message) -> None:
    """Print the cost of sending a message that is answered with 202, with both sides on one core."""

    async def accept(message: Message) -> None:
        return None

    with asyncio.Runner() as runner:
        server, wire = Server("127.0.0.1", 0, {"/here": accept}), Wire()
        runner.run(server.start())
        request = Message(header=msgspec.structs.replace(message.header, recipient=f"{server.url}/here"), body=message.body)
        ways = {
            "encode and decode": lambda: soap.decode(soap.encode(request)),
            "Wire.post to a Server, on a kept connection": lambda: runner.run(wire.post(request)),
        }
        side_by_side("handing over an Arrange", ways)
        runner.run(wire.close())
        runner.run(server.stop())


def main() -> None:
    for name, (header, body) in EXAMPLES.items():
        compare(name, Message(header=header, body=body))
    over_http(Message(header=SESSION, body=ARRANGE))


if __name__ == "__main__":
    main()
