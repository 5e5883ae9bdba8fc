"""A device with a passkey, as a program: it answers as real ones do (Web Authentication Level 3, section 6), or wrongly."""

from __future__ import annotations

import base64
import hashlib
import json
import secrets
from typing import Any

import cbor2
from cryptography.hazmat.primitives.asymmetric.ec import ECDSA, SECP256R1, generate_private_key
from cryptography.hazmat.primitives.hashes import SHA256

USER_PRESENT, USER_VERIFIED, HAS_CREDENTIAL = 0x01, 0x04, 0x40

COSE_TYPE, COSE_ALGORITHM, COSE_CURVE, COSE_X, COSE_Y = 1, 3, -1, -2, -3
EC2, ES256, P256 = 2, -7, 1


def base64url(content: bytes) -> str:
    return base64.urlsafe_b64encode(content).rstrip(b"=").decode()


class SoftAuthenticator:
    """A device with one passkey, in a browser with a page of `origin`. `host`: for which it acts; empty: the one that it is asked for."""

    def __init__(self, origin: str) -> None:
        self.origin, self.host = origin, ""
        self.recognizes_user = True
        self.sign_count = 0
        self.id = secrets.token_bytes(16)
        self._key = generate_private_key(SECP256R1())

    def create(self, options: dict[str, Any]) -> dict[str, Any]:
        """The answer to a request for a new passkey."""
        numbers = self._key.public_key().public_numbers()
        key = {
            COSE_TYPE: EC2,
            COSE_ALGORITHM: ES256,
            COSE_CURVE: P256,
            COSE_X: numbers.x.to_bytes(32),
            COSE_Y: numbers.y.to_bytes(32),
        }
        credential = bytes(16) + len(self.id).to_bytes(2) + self.id + cbor2.dumps(key)
        data = self._data(options["rp"]["id"], HAS_CREDENTIAL) + credential
        attestation = cbor2.dumps({"fmt": "none", "attStmt": {}, "authData": data})
        client_data = self._client_data("webauthn.create", options["challenge"])
        return self._answer({"clientDataJSON": base64url(client_data), "attestationObject": base64url(attestation)})

    def get(self, options: dict[str, Any]) -> dict[str, Any]:
        """The answer to a request to sign in."""
        self.sign_count += 1
        data, client_data = self._data(options["rpId"]), self._client_data("webauthn.get", options["challenge"])
        signature = self._key.sign(data + hashlib.sha256(client_data).digest(), ECDSA(SHA256()))
        return self._answer(
            {"clientDataJSON": base64url(client_data), "authenticatorData": base64url(data), "signature": base64url(signature)}
        )

    def _data(self, host: str, flags: int = 0) -> bytes:
        flags |= USER_PRESENT | (USER_VERIFIED if self.recognizes_user else 0)
        return hashlib.sha256((self.host or host).encode()).digest() + bytes([flags]) + self.sign_count.to_bytes(4)

    def _client_data(self, type: str, challenge: str) -> bytes:
        return json.dumps({"type": type, "challenge": challenge, "origin": self.origin, "crossOrigin": False}).encode()

    def _answer(self, response: dict[str, str]) -> dict[str, Any]:
        return {"id": base64url(self.id), "rawId": base64url(self.id), "type": "public-key", "response": response}
