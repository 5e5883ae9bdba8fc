"""A robot of another make, written against the documents alone: a SOAP client, an HTTP server, and numbers to remember.

It imports nothing of SO-MRS. It needs no time to drive: it is at a place as soon as it may drive there.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import zeep
from lxml import etree

WSA = "http://www.w3.org/2005/08/addressing"
TRAFFIC = "urn:so-mrs:traffic:1.0"


@dataclass(kw_only=True)
class Stop:
    """A place of the roadmap: its point, its lift, and the places to which lanes lead, with the passages that have to be open."""

    x: float
    y: float
    level: float
    zone: str | None
    ends: dict[str, list[str]] = field(default_factory=dict)


class Inbox:
    """Takes the messages that come to the robot: SOAP envelopes in POST requests, which it answers with 202."""

    def __init__(self) -> None:
        self._arrived = threading.Condition()
        self._bodies: list[etree._Element] = []
        inbox = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                document = self.rfile.read(int(self.headers["Content-Length"]))
                inbox.take(etree.fromstring(document))
                self.send_response(202)
                self.send_header("Content-Length", "0")
                self.end_headers()

            def log_message(self, format: str, *args: object) -> None:
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()
        self.address = f"http://127.0.0.1:{self._server.server_port}/robot"

    def take(self, envelope: etree._Element) -> None:
        with self._arrived:
            body = envelope.find("{*}Body")
            assert body is not None
            self._bodies.append(body[0])
            self._arrived.notify_all()

    def next(self, seconds: float) -> etree._Element | None:
        """The next message; None if none comes within so many seconds."""
        with self._arrived:
            self._arrived.wait_for(lambda: self._bodies, seconds)
            return self._bodies.pop(0) if self._bodies else None

    def close(self) -> None:
        self._server.shutdown()
        self._server.server_close()


class ForeignRobot:
    """One robot. `place`: where it is; `way`: the places after it up to which it may drive."""

    def __init__(self, name: str, traffic: str, seconds: float) -> None:
        self.name = name
        self.inbox = Inbox()
        self._soap = zeep.Client(f"{traffic}?wsdl", transport=zeep.Transport(timeout=seconds, operation_timeout=seconds))  # type: ignore[no-untyped-call]
        self.service: Any = self._soap.service
        self.places: dict[str, Stop] = {}
        self.edition = 0
        self.place = ""
        self.fence = self.number = self.grant = self.progress = 0
        self.way: list[str] = []
        self.driven: list[str] = []
        """All places that it has come to, in order."""
        self.ended: dict[str, tuple[str, list[str]]] = {}
        """By trip: its result, and the robots in the way."""
        self.is_replaced = False
        self._gated: set[int] = set()
        """The places before which it waits for PassageOpen, by the progress with which it comes to them."""
        self._returned = 0
        """The number of the report with which it gave its way back last."""
        self._open: tuple[int, str] | None = None
        """Before which place the passages are open, with the progress of that time."""
        self.on_arrival: Callable[[str, str], None] = lambda start, end: None

    def _from(self) -> list[etree._Element]:
        header = etree.Element(f"{{{WSA}}}From")
        etree.SubElement(header, f"{{{WSA}}}Address").text = self.inbox.address
        return [header]

    def read_roadmap(self) -> None:
        self.places, after = {}, 0
        while True:
            page = self.service.ReadRoadmap(After=after)
            self.edition = page.Edition
            for place in page.Places:
                ends = {lane.End: [*lane.Passages] for lane in place.Lanes}
                self.places[place.Name] = Stop(x=place.X, y=place.Y, level=place.Level or 0.0, zone=place.Zone, ends=ends)
            if not page.More:
                return
            after = page.Next

    def nearest(self, x: float, y: float, level: float = 0.0) -> str:
        """The place of the roadmap that is nearest to a point."""
        on_level = [name for name, place in self.places.items() if abs(place.level - level) < 0.5]
        return min(on_level, key=lambda name: self.distance(name, x, y))

    def distance(self, name: str, x: float, y: float) -> float:
        """How far a place is from a point, in metres."""
        return math.dist((self.places[name].x, self.places[name].y), (x, y))

    def enter(self, place: str, lease: float, **values: object) -> Any:
        answer = self.service.EnterTraffic(Robot=self.name, Place=place, Lease=lease, _soapheaders=self._from(), **values)
        self.place, self.way, self.fence = place, [], answer.Fence
        self.number = self.grant = self.progress = self._returned = 0
        return answer

    def report(self, **values: object) -> Any:
        self.number += 1
        return self.service.ReportPlace(
            Robot=self.name,
            Fence=self.fence,
            Number=self.number,
            Grant=self.grant,
            Progress=self.progress,
            Place=self.place,
            **values,
        )

    def request(self, trip: str, destination: str) -> Any:
        self.number += 1
        return self.service.RequestTrip(Robot=self.name, Fence=self.fence, Number=self.number, Trip=trip, Destination=destination)

    def take_message(self, seconds: float) -> bool:
        """Handle the next message. Returns whether one came within so many seconds."""
        body = self.inbox.next(seconds)
        if body is None:
            return False
        texts: dict[str, list[str]] = {}
        for element in body:
            texts.setdefault(etree.QName(element).localname, []).append(element.text or "")
        match etree.QName(body).localname:
            case "Granted" if int(texts["Fence"][0]) == self.fence and int(texts["Number"][0]) > self.grant:
                self.grant = int(texts["Number"][0])
                self.way = texts["Way"][self.progress - int(texts["Progress"][0]) + 1 :]
                self._gated = {int(texts["Progress"][0]) + int(number) for number in texts.get("Gated", [])}
            case "TripEnded":
                self.ended[texts["Trip"][0]] = texts["Result"][0], texts.get("Robots", [])
            case "PassageOpen" if int(texts["Fence"][0]) == self.fence and int(texts["Report"][0]) >= self._returned:
                self._open = int(texts["Progress"][0]), texts["Place"][0]
            case "PassageClosed" if (int(texts["Fence"][0]), int(texts["Progress"][0])) == (self.fence, self.progress):
                if self.way[:1] == texts["Place"]:
                    self.way, self._open = [], None
                    self.report(Mobility="busy")
                    self._returned = self.number
                    self.report()
            case "RoadmapReplaced" if int(texts["Fence"][0]) == self.fence:
                self.is_replaced = True
        return True

    def drive(self) -> None:
        """Drive as far as places are granted and passages are open, and report each place."""
        while self.way and not self._waits_for_passage(self.way[0]):
            self.on_arrival(self.place, self.way[0])
            self.place = self.way.pop(0)
            self.driven.append(self.place)
            self.progress += 1
            self.report()

    def _waits_for_passage(self, following: str) -> bool:
        return self.progress + 1 in self._gated and self._open != (self.progress, following)

    def drive_until(self, is_over: Callable[[], bool], renew_within: float = 1.0) -> None:
        """Drive where places are granted, and renew the lease, until the condition holds."""
        while not is_over():
            if not self.take_message(renew_within):
                self.report()
            self.drive()

    def wait_until(self, is_over: Callable[[], bool]) -> None:
        """Take messages where it stands, and say nothing, until the condition holds."""
        while not is_over():
            self.take_message(0.05)

    def close(self) -> None:
        self.inbox.close()
