"""Passkeys (Web Authentication Level 3): what browsers are asked for, and whether what they answer proves it. No file, no page.

A passkey is for one host. It proves that a person has a device and was recognized by it, as by a fingerprint, and so takes the place of a
password.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
import time
from collections.abc import Callable, Collection
from typing import Any

from somrs.access.state import Passkey, checked_name
from somrs.errors import UsageError

CHALLENGE_TIME = 600.0
"""Seconds in which a challenge has to be answered."""

ANSWER_MILLISECONDS = int(CHALLENGE_TIME * 1000)

SITE_NAME = "SO-MRS"
"""What browsers and devices show with a passkey."""

BEGIN_AGAIN = "The passkey was used too late, or a second time. Begin again."


class Challenges:
    """Challenges of this program. None is stored until it has been answered, so nobody can use up the place for them.

    A challenge is a random number with the time and a code (HMAC-SHA256) that also covers its `purpose`: one for something else does not
    count. `clock`: in seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._key = clock, secrets.token_bytes(32)
        self._answered: dict[bytes, float] = {}

    def new(self, purpose: str) -> bytes:
        content = secrets.token_bytes(16) + int(self._clock() * 1000).to_bytes(8)
        return content + self._code(content, purpose)

    def use(self, challenge: bytes, purpose: str) -> None:
        """Accept a challenge, once. Raises UsageError if it is none of this program for this purpose, was used, or is too old."""
        content, code = challenge[:24], challenge[24:]
        now = self._clock()
        self._answered = {answered: end for answered, end in self._answered.items() if end > now}
        age = now - int.from_bytes(content[16:]) / 1000
        if not hmac.compare_digest(code, self._code(content, purpose)) or age > CHALLENGE_TIME or challenge in self._answered:
            raise UsageError(BEGIN_AGAIN)
        self._answered[challenge] = now + CHALLENGE_TIME

    def _code(self, content: bytes, purpose: str) -> bytes:
        return hmac.digest(self._key, content + purpose.encode(errors="surrogatepass"), "sha256")


def registration_options(host: str, account: str, system: str, earlier_ids: Collection[str], challenge: bytes) -> str:
    """What the browser makes a passkey from, as JSON. `system`: the id of this one; `earlier_ids`: of the account's passkeys, so that no
    device gets two."""
    from webauthn import base64url_to_bytes, generate_registration_options, options_to_json
    from webauthn.helpers.structs import (
        AuthenticatorSelectionCriteria,
        PublicKeyCredentialDescriptor,
        ResidentKeyRequirement,
        UserVerificationRequirement,
    )

    options = generate_registration_options(
        rp_id=host,
        rp_name=SITE_NAME,
        user_id=hashlib.sha256(f"{system} {account}".encode()).digest(),  # the same for all passkeys of a person, and no name
        user_name=account,
        challenge=challenge,
        timeout=ANSWER_MILLISECONDS,
        authenticator_selection=AuthenticatorSelectionCriteria(
            resident_key=ResidentKeyRequirement.REQUIRED, user_verification=UserVerificationRequirement.REQUIRED
        ),
        exclude_credentials=[PublicKeyCredentialDescriptor(id=base64url_to_bytes(id)) for id in earlier_ids],
    )
    return options_to_json(options)


def sign_in_options(host: str, challenge: bytes) -> str:
    """What the browser signs in with, as JSON. Which passkey it is, the person chooses there: nobody has to say a name before."""
    from webauthn import generate_authentication_options, options_to_json
    from webauthn.helpers.structs import UserVerificationRequirement

    options = generate_authentication_options(
        rp_id=host, challenge=challenge, timeout=ANSWER_MILLISECONDS, user_verification=UserVerificationRequirement.REQUIRED
    )
    return options_to_json(options)


def challenge_of(credential: dict[str, Any]) -> bytes:
    """The challenge that a browser has answered, as it says. Raises UsageError if it says none."""
    from webauthn import base64url_to_bytes
    from webauthn.helpers import parse_client_data_json
    from webauthn.helpers.exceptions import WebAuthnException

    try:
        return parse_client_data_json(base64url_to_bytes(credential["response"]["clientDataJSON"])).challenge
    except (WebAuthnException, ValueError, KeyError, TypeError, AttributeError):
        raise UsageError("This is not the answer of a passkey.") from None


def registered(credential: dict[str, Any], challenge: bytes, host: str, origin: str, account: str, name: str) -> Passkey:
    """The new passkey that a browser has made. Raises UsageError if it is not for this account at this host."""
    from webauthn import verify_registration_response
    from webauthn.helpers import bytes_to_base64url
    from webauthn.helpers.exceptions import WebAuthnException

    try:
        proof = verify_registration_response(
            credential=credential,
            expected_challenge=challenge,
            expected_rp_id=host,
            expected_origin=origin,
            require_user_verification=True,
        )
    except (WebAuthnException, ValueError, KeyError, TypeError) as error:
        raise UsageError(f"This passkey cannot be used: {error}.") from None
    return Passkey(
        id=bytes_to_base64url(proof.credential_id),
        name=checked_name(name),
        account=account,
        host=host,
        public_key=proof.credential_public_key,
        sign_count=proof.sign_count,
        created_at=time.time(),
    )


def sign_count_of(passkey: Passkey, credential: dict[str, Any], challenge: bytes, host: str, origin: str) -> int:
    """How often a passkey has been used, now that it is used again. Raises UsageError if the browser's answer does not prove that it is."""
    from webauthn import verify_authentication_response
    from webauthn.helpers.exceptions import WebAuthnException

    try:
        proof = verify_authentication_response(
            credential=credential,
            expected_challenge=challenge,
            expected_rp_id=host,
            expected_origin=origin,
            credential_public_key=passkey.public_key,
            credential_current_sign_count=passkey.sign_count,
            require_user_verification=True,
        )
    except (WebAuthnException, ValueError, KeyError, TypeError) as error:
        raise UsageError(f"The passkey {passkey.name} of {passkey.account} proves nothing: {error}.") from None
    return proof.new_sign_count
