"""Passkeys in a real browser, with the authenticator that Chromium has for tests."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, CDPSession, Page, expect

from somrs.access.rights import PersonRole
from tests.support.signed_in import note

from .conftest import RunningSystem, sign_in, take_looks

INTERNAL = {
    "protocol": "ctap2",
    "transport": "internal",
    "hasResidentKey": True,
    "hasUserVerification": True,
    "isUserVerified": True,
    "automaticPresenceSimulation": True,
}
"""A device such as a telephone, whose user is recognized, and agrees to everything."""


class Visit:
    """A page of the system at its name, with an authenticator."""

    def __init__(self, page: Page, session: CDPSession, url: str) -> None:
        self.page, self._session, self.url = page, session, url
        session.send("WebAuthn.enable")
        self.device = self.add_device()

    def add_device(self) -> str:
        answer = self._session.send("WebAuthn.addVirtualAuthenticator", {"options": INTERNAL})
        return str(answer["authenticatorId"])

    def replace_device(self) -> None:
        self._session.send("WebAuthn.removeVirtualAuthenticator", {"authenticatorId": self.device})
        self.device = self.add_device()

    def recognize_user(self, *, recognizes: bool) -> None:
        self._session.send("WebAuthn.setUserVerified", {"authenticatorId": self.device, "isUserVerified": recognizes})


@pytest.fixture
def visit(system: RunningSystem, browser: Browser) -> Iterator[Visit]:
    url = system.url.replace("127.0.0.1", "localhost")
    note(system.data, url)
    with browser.new_context() as profile:
        sign_in(profile, url, PersonRole.OPERATOR, "Grace")
        page = profile.new_page()
        yield Visit(page, profile.new_cdp_session(page), url)


def add_passkey(page: Page, name: str) -> None:
    page.get_by_label("Name of the passkey").fill(name)
    page.get_by_role("button", name="Add passkey").click()
    expect(page.get_by_role("group", name=f"Passkey {name}")).to_be_visible()


def test_one_adds_passkeys_signs_in_with_one_and_removes_them(visit: Visit) -> None:
    page = visit.page
    page.goto(f"{visit.url}/access")
    add_passkey(page, "Phone")
    page.get_by_role("button", name="Add passkey").click()
    expect(page.get_by_text("This device has a passkey of yours already.")).to_be_visible()
    visit.replace_device()
    add_passkey(page, "Key on the ring")
    take_looks(page, "passkeys")
    page.get_by_role("button", name="account").click()
    page.get_by_role("menuitem", name="Sign out").click()
    button = page.get_by_role("button", name="Sign in with a passkey")
    expect(button).to_be_visible()
    take_looks(page, "passkey-sign-in")
    visit.recognize_user(recognizes=False)
    button.click()
    expect(page.get_by_role("alert")).to_have_text("No passkey was used: that was cancelled, or there is none for this address here.")
    visit.recognize_user(recognizes=True)
    page.goto(f"{visit.url}/access")
    button.click()
    expect(page).to_have_url(f"{visit.url}/access")
    expect(page.get_by_role("heading", name="Grace")).to_be_visible()
    key = page.get_by_role("group", name="Passkey Key on the ring")
    expect(key).to_contain_text("at localhost, since")
    expect(key).to_contain_text("used")
    expect(page.get_by_role("group", name="Passkey Phone")).to_contain_text("never used")
    key.get_by_role("button", name="Remove").click()
    page.get_by_role("button", name="Remove Key on the ring").click()
    expect(key).to_have_count(0)
    page.get_by_role("button", name="account").click()
    page.get_by_role("menuitem", name="Sign out").click()
    button.click()
    expect(page.get_by_role("alert")).to_have_text("This passkey is not known here; it may have been removed. Sign in in another way.")


def test_an_ip_address_has_no_passkeys(system: RunningSystem, browser: Browser) -> None:
    with browser.new_context() as profile:
        sign_in(profile, system.url, PersonRole.OPERATOR, "Katherine")
        page = profile.new_page()
        page.goto(f"{system.url}/access")
        expect(page.get_by_text("Passkeys are for names, and not for IP addresses")).to_be_visible()
        expect(page.get_by_role("button", name="Add passkey")).to_have_count(0)
