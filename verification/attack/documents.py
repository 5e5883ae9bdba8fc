"""Documents that are small to send and large to read, and requests that two servers would read differently."""

from __future__ import annotations

import json

from verification.attack.target import JSON, SOAP, Target, expect

ENTITIES = "".join(f'<!ENTITY e{number} "{f"&e{number - 1};" * 10 if number else "x" * 10}">' for number in range(10))

XML: dict[str, bytes] = {
    "billion laughs": f"<!DOCTYPE a [{ENTITIES}]><a>&e9;</a>".encode(),
    "quadratic entities": b'<!DOCTYPE a [<!ENTITY a "' + b"x" * 50_000 + b'">]><a>' + b"&a;" * 20_000 + b"</a>",
    "external entity": b'<!DOCTYPE a [<!ENTITY a SYSTEM "file:///etc/passwd">]><a>&a;</a>',
    "external entity by HTTP": b'<!DOCTYPE a SYSTEM "http://127.0.0.1:1/a.dtd"><a/>',
    "parameter entity": b'<!DOCTYPE a [<!ENTITY % a SYSTEM "file:///etc/passwd"> %a;]><a/>',
    "depth": b"<a>" * 80_000,
    "attributes": b"<a " + b" ".join(b'a%d="x"' % number for number in range(20_000)) + b"/>",
    "namespaces": b"<a " + b" ".join(b'xmlns:a%d="x"' % number for number in range(10_000)) + b"/>",
    "inclusion": b'<a xmlns:xi="http://www.w3.org/2001/XInclude"><xi:include href="file:///etc/passwd" parse="text"/></a>',
    "UTF-16 without a mark": "<a/>".encode("utf-16-le"),
    "UTF-7": b'<?xml version="1.0" encoding="utf-7"?>+ADw-a/+AD4-',
    "zeros": b"\x00" * 200_000,
    "comments": b"<a>" + b"<!---->" * 30_000 + b"</a>",
    "many elements": b"<a>" + b"<b/>" * 60_000 + b"</a>",
}

DEEP = (
    b"[" * 200_000,
    b'{"effect":' * 100_000,
    b'{"a":' * 100_000 + b"1" + b"}" * 100_000,
    b'{"effect": ' + b"[" * 100_000 + b"]" * 100_000 + b"}",
)


async def xml_is_small(target: Target) -> None:
    for server, url in target.soap.items():
        for kind, document in XML.items():
            answer = await target.request(url, "POST", SOAP, document)
            expect(answer.status in (400, 413, 500), f"{server}: {kind} gets {answer.status}")
            expect(b"Fault" in answer.content or answer.status == 413, f"{server}: {kind} gets no Fault: {answer.text[:100]}")
            expect("root:" not in answer.text and "internal error" not in answer.text, f"{server}: {kind} gets {answer.text[:500]}")


async def json_is_flat(target: Target) -> None:
    for server, url in target.web.items():
        for document in DEEP:
            for path in ("/api/tasks", "/api/map/changes", "/api/formulas/check", "/api/tasks/preview"):
                answer = await target.request(url, "POST", JSON, document, path=path)
                expect(400 <= answer.status < 500, f"{server}: deep JSON at {path} gets {answer.status}")


FORMULAS = (
    "(" * 20_000 + "Jar002 isOn Platform001" + ")" * 20_000,
    "not " * 10_000 + "Jar002 isOn Platform001",
    " and ".join(["Jar002 isOn Platform001"] * 2_000),
    " or ".join(["Jar002 isOn ?X"] * 1_000),
    "Jar002." * 5_000 + "Weight = 1",
    "Jar002.Weight = " + "9" * 10_000,
    "Jar002.Weight = " + " + ".join(["1"] * 5_000),
    "\u202eJar002 isOn Platform001",
    "\x00",
)


async def formulas_are_read_or_refused(target: Target) -> None:
    for formula in FORMULAS:
        for path, field in (("/api/formulas/check", "text"), ("/api/tasks/preview", "effect")):
            answer = await target.request(target.api, "POST", JSON, json.dumps({field: formula}).encode(), path=path)
            expect(answer.status < 500 or answer.status == 503, f"{path}: {formula[:40]!r}... gets {answer.status} {answer.text[:300]}")


SMUGGLED = b"GET /smuggled HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"

FRAMINGS: dict[str, bytes] = {
    "both lengths": b"Content-Length: 4\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
    "chunked and length": b"Transfer-Encoding: chunked\r\nContent-Length: 4\r\n\r\n0\r\n\r\n",
    "two lengths": b"Content-Length: 0\r\nContent-Length: 44\r\n\r\n",
    "a list of lengths": b"Content-Length: 0, 44\r\n\r\n",
    "a signed length": b"Content-Length: +0\r\n\r\n",
    "a hexadecimal length": b"Content-Length: 0x0\r\n\r\n",
    "a negative length": b"Content-Length: -1\r\n\r\n",
    "a huge length": b"Content-Length: 99999999999999999999999\r\n\r\n",
    "an unknown coding": b"Transfer-Encoding: xchunked\r\n\r\n0\r\n\r\n",
    "codings": b"Transfer-Encoding: chunked, identity\r\n\r\n0\r\n\r\n",
    "a space before the colon": b"Transfer-Encoding : chunked\r\n\r\n0\r\n\r\n",
    "a tab": b"Transfer-Encoding:\x0bchunked\r\n\r\n0\r\n\r\n",
    "a folded line": b"Transfer-Encoding:\r\n chunked\r\n\r\n0\r\n\r\n",
    "a bare line feed": b"X: x\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
    "a bare carriage return": b"X: x\rTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
    "a chunk of negative size": b"Transfer-Encoding: chunked\r\n\r\n-1\r\n\r\n",
    "a chunk of huge size": b"Transfer-Encoding: chunked\r\n\r\nfffffffffffffffff\r\n\r\n",
    "a zero byte": b"X: \x00\r\nContent-Length: 0\r\n\r\n",
}


async def requests_have_one_reading(target: Target) -> None:
    """Framing that another server could read otherwise is refused, and what follows is not a request."""
    for server, url in {**target.web, **target.soap}.items():
        host = url.split("//")[1].split("/")[0].encode()
        for kind, framing in FRAMINGS.items():
            async with target.connection(url) as line:
                await line.send(
                    b"POST /api/tasks HTTP/1.1\r\nHost: " + host + b"\r\nContent-Type: application/json\r\n" + framing + SMUGGLED
                )
                content = await line.end() if kind != "a folded line" else b""
            expect(b"smuggled" not in content, f"{server}: {kind} smuggles a request: {content[:300]!r}")
            expect(content.startswith((b"", b"HTTP/1.1 4")) and b"HTTP/1.1 5" not in content, f"{server}: {kind} gets {content[:200]!r}")
