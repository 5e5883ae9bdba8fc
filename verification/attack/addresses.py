"""Messages that would have components send elsewhere, keep much for somebody, or wait for what is not theirs."""

from __future__ import annotations

from somrs.limits import Limits
from somrs.protocol.messages import directory, frp, knowledge, submission, task_news
from somrs.protocol.messages.bodies import Body
from verification.attack.target import JSON, Target, expect

ELSEWHERE = (
    "http://192.0.2.7:80/x",
    "http://169.254.169.254/latest/meta-data",
    "http://[2001:db8::1]/x",
    "HTTP://user@192.0.2.7/",
    "http://no-such-host.invalid/",
)


async def nobody_else_is_sent_anything(target: Target) -> None:
    for server, address in target.soap.items():
        for elsewhere in ELSEWHERE:
            for field in ("sender", "reply_to"):
                answer = await target.post_message(address, knowledge.ReadMap(), **{field: elsewhere})
                expect(answer.status == 400 and "SOMRS_REPLY_HOSTS" in answer.text, f"{server}: {field} {elsewhere} gets {answer.status}")
    offer = (await target.client.services())[0]
    for elsewhere in ELSEWHERE:
        false_offer = directory.Offer(
            service="Nobody.Work", provider="Nobody", provider_type="Robot", address=elsewhere, service_type=offer.service_type
        )
        publication = directory.Publish(provider="Nobody", offers=(false_offer,), lease=5)
        answer = await target.post_message(target.soap["Registry"], publication)
        expect(answer.status == 400, f"a service at {elsewhere} is listed: {answer.status}")


async def requests_for_others_are_refused(target: Target) -> None:
    device_address = (await target.client.services())[0].address
    requests: tuple[Body, ...] = (directory.Discover(), knowledge.ReadMap(), task_news.ReadTasks(), submission.CancelTask(task="x"))
    for server, address in {**target.soap, "device": device_address}.items():
        for body in requests:
            answer = await target.post_message(address, body)
            expect(answer.status in (200, 400), f"{server}: {type(body).__name__} gets {answer.status}")
    answer = await target.post_message(device_address, frp.Query(), transaction="urn:uuid:1", participant="Nobody#1")
    expect(answer.status in (200, 400), f"device: Query gets {answer.status}")


async def subscribers_are_bounded(target: Target) -> None:
    most = Limits().subscribers
    for server, body in (("Repository", knowledge.SubscribeMap(lease=300)), ("Registry", directory.SubscribeServices(lease=300))):
        refused = 0
        for number in range(most + 50):
            answer = await target.post_message(target.soap[server], body, sender=f"http://127.0.0.1:1/{number}")
            refused += answer.status == 400
        expect(refused, f"{server}: {most + 50} subscribe, and none is refused")


NUMBERS = ("-1", "1e308", "1e999", "NaN", "9" * 30, "1.5", "")


async def numbers_have_ranges(target: Target) -> None:
    for number in NUMBERS:
        for path in ("/api/tasks?limit=", "/api/records?limit=", "/api/map/events?limit=", "/api/map/query?formula=?x%20isOn%20?y&limit="):
            answer = await target.request(target.api, path=path + number)
            expect(400 <= answer.status < 500, f"GET {path}{number} gets {answer.status}")
    for number in ("-1", "0", "1e308", "1e999", "NaN", '"x"', "[]"):
        body = f'{{"effect": "Jar002 isOn Platform001", "deadline": {number}}}'.encode()
        answer = await target.request(target.api, "POST", JSON, body, path="/api/tasks")
        expect(answer.status == 400, f"a deadline of {number} gets {answer.status}: {answer.text[:200]}")
