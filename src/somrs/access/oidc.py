"""Who signs in at an OpenID Connect provider: the authorization code flow with PKCE (OpenID Connect Core 1.0, section 3.1; RFC 7636).

It has no pages: those who serve some lead the browser to `Provider.begin`, and hand over what it comes back with.
"""

from __future__ import annotations

import base64
import hashlib
import secrets
import time
from collections.abc import Callable, Mapping
from typing import Any, TypeVar
from urllib.parse import quote, urlencode

import aiohttp
import msgspec
from msgspec import Struct

from somrs.access.oidc_settings import OidcSettings, values_of
from somrs.access.rights import PersonRole
from somrs.access.state import MAX_NAME, Subject, new_secret
from somrs.errors import RemoteError, UsageError

_T = TypeVar("_T")

MOST_BYTES = 2**20
"""Bytes of an answer of the provider."""

ANSWER_SECONDS = 60.0
"""How long an answer of the provider is waited for. The person who signs in waits as long, and can try again."""

DISCOVERY_SECONDS = 3600.0
"""How long the provider's description of itself, and its keys, are used."""

CLOCK_DIFFERENCE = 60.0
"""Seconds by which the clocks of both computers may differ."""

MOST_SHOWN = 200
"""Characters of what the provider says that people are shown."""

ALGORITHMS = ("RS256", "RS384", "RS512", "PS256", "PS384", "PS512", "ES256", "ES384", "ES512", "EdDSA", "Ed25519")
"""The signatures that are accepted: those for which the provider alone has the key."""


class Description(Struct, frozen=True, kw_only=True):
    """What the provider says of itself (OpenID Connect Discovery 1.0, section 3), as far as it is used."""

    issuer: str
    authorization_endpoint: str
    token_endpoint: str
    jwks_uri: str
    userinfo_endpoint: str = ""
    end_session_endpoint: str = ""
    token_endpoint_auth_methods_supported: tuple[str, ...] = ("client_secret_basic",)
    authorization_response_iss_parameter_supported: bool = False


class Flow(Struct, frozen=True, kw_only=True):
    """A sign-in that has begun, which the browser keeps until it comes back. `next`: the page that was wanted."""

    state: str
    nonce: str
    verifier: str
    next: str = ""


class ProvenPerson(Struct, frozen=True, kw_only=True):
    """Whom the provider has identified. `names`: from the plainest to one that nobody else has. `role`: None: it has none here."""

    subject: Subject
    names: tuple[str, ...]
    role: PersonRole | None
    groups: tuple[str, ...] = ()


class _Tokens(Struct, frozen=True, kw_only=True):
    id_token: str
    access_token: str = ""


class Provider:
    """The provider of the settings. Its description and its keys are read when they are needed. `clock`: seconds since 1970."""

    def __init__(self, settings: OidcSettings, clock: Callable[[], float] = time.time) -> None:
        self.settings, self._clock = settings, clock
        self._description: tuple[float, Description] | None = None
        self._keys: Any = None

    async def begin(self, return_url: str, next: str = "") -> tuple[str, Flow]:
        """The address to which the browser goes, and what it keeps meanwhile. Raises RemoteError if the provider does not answer."""
        description = await self._discovered()
        flow = Flow(state=new_secret(), nonce=new_secret(), verifier=secrets.token_urlsafe(48), next=next)
        challenge = base64.urlsafe_b64encode(hashlib.sha256(flow.verifier.encode()).digest()).rstrip(b"=").decode()
        request = {
            "response_type": "code",
            "client_id": self.settings.client,
            "redirect_uri": return_url,
            "scope": " ".join(self.settings.scopes),
            "state": flow.state,
            "nonce": flow.nonce,
            "code_challenge": challenge,
            "code_challenge_method": "S256",
        }
        return _with_query(description.authorization_endpoint, request), flow

    async def person(self, flow: Flow | None, answer: Mapping[str, str], return_url: str) -> ProvenPerson:
        """Who has signed in, by the parameters with which the browser came back.

        Raises UsageError, with what to do next, if they prove nothing; RemoteError if the provider does not answer.
        """
        if flow is None or not secrets.compare_digest(flow.state.encode(), answer.get("state", "").encode()):
            raise UsageError("This sign-in did not begin in this browser, or too long ago. Begin again.")
        name, description = self.settings.name, await self._discovered()
        issuer = answer.get("iss", "")
        if issuer != description.issuer and (issuer or description.authorization_response_iss_parameter_supported):
            raise UsageError(f"The answer is of {issuer or 'an unknown provider'} and not of {name}. Begin again.")
        if error := answer.get("error"):
            text = answer.get("error_description", "")
            raise UsageError(f"{name} did not sign you in ({_plain(error)}{': ' if text else ''}{_plain(text)}).")
        tokens = await self._exchange(description, answer.get("code", ""), flow.verifier, return_url)
        claims = await self._checked(description, tokens.id_token, flow.nonce)
        return self._person(await self._with_more(description, claims, tokens.access_token))

    async def sign_out_url(self, return_url: str) -> str | None:
        """The address at which one also signs out at the provider; None if it has none (OpenID Connect RP-Initiated Logout 1.0)."""
        address = (await self._discovered()).end_session_endpoint
        return _with_query(address, {"client_id": self.settings.client, "post_logout_redirect_uri": return_url}) if address else None

    async def _discovered(self) -> Description:
        now = time.monotonic()
        if self._description is None or now - self._description[0] > DISCOVERY_SECONDS:
            url = f"{self.settings.issuer.rstrip('/')}/.well-known/openid-configuration"
            description = self._converted(await self._read("GET", url), Description)
            if description.issuer != self.settings.issuer:
                problem = (
                    f"{self.settings.name} calls itself {_plain(description.issuer)}; whoever runs this site has to write that as `issuer`"
                )
                raise UsageError(problem)
            self._description, self._keys = (now, description), None  # a key that it has withdrawn is not used for ever
        return self._description[1]

    async def _exchange(self, description: Description, code: str, verifier: str, return_url: str) -> _Tokens:
        """The tokens for a code, which the provider gives once."""
        form = {"grant_type": "authorization_code", "code": code, "redirect_uri": return_url, "code_verifier": verifier}
        headers, settings = {}, self.settings
        if settings.secret and "client_secret_basic" in description.token_endpoint_auth_methods_supported:
            credentials = f"{quote(settings.client, safe='')}:{quote(settings.secret, safe='')}"  # RFC 6749, section 2.3.1
            headers["Authorization"] = f"Basic {base64.b64encode(credentials.encode()).decode()}"
        else:
            form |= {"client_id": settings.client} | ({"client_secret": settings.secret} if settings.secret else {})
        return self._converted(await self._read("POST", description.token_endpoint, headers, form), _Tokens)

    async def _checked(self, description: Description, id_token: str, nonce: str) -> dict[str, Any]:
        """What an ID token says (OpenID Connect Core 1.0, section 3.1.3.7). Raises UsageError if it is not for this sign-in."""
        name, claims = self.settings.name, await self._signed(description, id_token)
        if claims.get("iss") != description.issuer:
            raise UsageError(f"The answer is of {_plain(claims.get('iss'))} and not of {name}. Begin again.")
        audience = claims.get("aud")
        clients = audience if isinstance(audience, list) else [audience]
        if self.settings.client not in clients or claims.get("azp", self.settings.client) != self.settings.client:
            raise UsageError(f"The answer of {name} is for {_plain(clients)} and not for this system. Begin again.")
        if not secrets.compare_digest(str(claims.get("nonce", "")).encode(), nonce.encode()):
            raise UsageError(f"The answer of {name} is for another sign-in. Begin again.")
        now, end, start = self._clock(), claims.get("exp"), claims.get("iat")
        if not isinstance(end, int | float) or end + CLOCK_DIFFERENCE <= now:
            raise UsageError(f"The answer of {name} is not valid any more. Begin again; if that does not help, a clock is wrong.")
        if not isinstance(start, int | float) or start - CLOCK_DIFFERENCE > now:
            raise UsageError(f"The answer of {name} is not valid yet: a clock is wrong, there or here.")
        if not isinstance(claims.get("sub"), str) or not claims["sub"]:
            raise UsageError(f"The answer of {name} does not say who you are.")
        return claims

    async def _signed(self, description: Description, id_token: str) -> dict[str, Any]:
        """The claims of a token, whose signature is of the provider. A new key of it is fetched when it has signed with it."""
        from joserfc.errors import InvalidKeyIdError, JoseError

        fetched = self._keys is None
        try:
            if fetched:
                self._keys = await self._read_keys(description)
            try:
                return _claims(id_token, self._keys)
            except InvalidKeyIdError:
                if fetched:
                    raise
                self._keys = await self._read_keys(description)
                return _claims(id_token, self._keys)
        except InvalidKeyIdError:
            raise UsageError(f"The answer is signed with a key that is none of {self.settings.name}.") from None
        except (JoseError, ValueError) as error:
            raise UsageError(f"The answer of {self.settings.name} is not signed as it has to be ({_plain(error)}).") from None

    async def _read_keys(self, description: Description) -> Any:
        from joserfc.errors import JoseError
        from joserfc.jwk import JWKRegistry, KeySet

        keys = []
        for key in self._converted(await self._read("GET", description.jwks_uri), dict[str, Any]).get("keys", []):
            try:
                if key.get("kty") != "oct" and key.get("use", "sig") == "sig":
                    keys.append(JWKRegistry.import_key(key))
            except (JoseError, ValueError, AttributeError):  # a kind that is not understood does not make the others useless
                continue
        return KeySet(keys)

    async def _with_more(self, description: Description, claims: dict[str, Any], access_token: str) -> dict[str, Any]:
        """The claims with those that the provider only states when it is asked (OpenID Connect Core 1.0, section 5.3)."""
        if not description.userinfo_endpoint or not access_token:
            return claims
        headers = {"Authorization": f"Bearer {access_token}"}
        userinfo = self._converted(await self._read("GET", description.userinfo_endpoint, headers), dict[str, Any])
        if userinfo.get("sub") != claims["sub"]:
            raise UsageError(f"{self.settings.name} speaks of somebody else than who signed in. Begin again.")
        return userinfo | claims

    def _person(self, claims: dict[str, Any]) -> ProvenPerson:
        texts = {key: " ".join(value.split()) for key, value in claims.items() if isinstance(value, str)}
        plain = texts.get("name") or texts.get("preferred_username") or texts.get("email") or texts["sub"]
        further = [texts[key] for key in ("preferred_username", "email", "sub") if texts.get(key) and texts[key] != plain]
        names = (_as_name(plain), *(_as_name(plain, f" ({text})") for text in further))
        return ProvenPerson(
            subject=Subject(issuer=self.settings.issuer, id=claims["sub"]),
            names=names,
            role=self.settings.role(claims),
            groups=values_of(claims, self.settings.claim),
        )

    async def _read(self, method: str, url: str, headers: Mapping[str, str] | None = None, form: Mapping[str, str] | None = None) -> bytes:
        """What the provider answers. Raises UsageError if it refuses, RemoteError if it does not answer."""
        timeout = aiohttp.ClientTimeout(total=ANSWER_SECONDS)
        try:
            async with (
                aiohttp.ClientSession(timeout=timeout) as session,
                session.request(method, url, headers=headers, data=form, allow_redirects=False) as response,
            ):
                content = bytearray()
                async for part in response.content.iter_chunked(2**16):
                    content += part
                    if len(content) > MOST_BYTES:
                        raise RemoteError(f"{self.settings.name} answers with more than {MOST_BYTES} bytes at {url}")
                status = response.status
        except (aiohttp.ClientError, OSError) as error:  # a time that is over is an OSError
            raise RemoteError(
                f"{self.settings.name} cannot be reached at {url} ({_plain(error) or type(error).__name__}); try again"
            ) from None
        if status == 200:
            return bytes(content)
        raise self._refusal(url, status, bytes(content))

    def _refusal(self, url: str, status: int, content: bytes) -> UsageError | RemoteError:
        """Why the provider does not do what it was asked to (RFC 6749, section 5.2)."""
        try:
            error = msgspec.json.decode(content, type=dict[str, Any])
        except msgspec.MsgspecError:
            error = {}
        code, text = _plain(error.get("error", "")), _plain(error.get("error_description", ""))
        if code == "invalid_grant":
            return UsageError(f"{self.settings.name} does not accept this sign-in any more: it was used, or its time is over. Begin again.")
        return RemoteError(f"{self.settings.name} answers with status {status} at {url}" + (f": {code} {text}".rstrip() if code else ""))

    def _converted(self, content: bytes, type: type[_T]) -> _T:
        try:
            return msgspec.json.decode(content, type=type)
        except msgspec.MsgspecError as error:
            raise RemoteError(f"{self.settings.name} answers with what is not understood: {error}") from None


def _claims(id_token: str, keys: Any) -> dict[str, Any]:
    """What a token says that is signed with one of these keys. Raises JoseError, or ValueError for what is no token."""
    from joserfc import jwt

    return {**jwt.decode(id_token, keys, algorithms=ALGORITHMS).claims}


def _with_query(address: str, parameters: Mapping[str, str]) -> str:
    return f"{address}{'&' if '?' in address else '?'}{urlencode(parameters)}"


def _plain(content: object) -> str:
    """What another program has sent, for people: a line that is not long."""
    return "".join(character if character.isprintable() else " " for character in str(content))[:MOST_SHOWN].strip()


def _as_name(text: str, suffix: str = "") -> str:
    """A text of the provider as a name in records, with a suffix that is not cut."""
    plain = " ".join("".join(character if character.isprintable() else " " for character in text + suffix).replace("/", "-").split())
    return plain if len(plain) <= MAX_NAME else f"{plain[: MAX_NAME - len(suffix) - 1].rstrip()}…{suffix}"[:MAX_NAME]
