"""The commands of the site's certificate authority: who has a certificate, and which."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from somrs.cli.options import DEFAULT_FOLDER, Data, Json, awaited, fail, guarded

if TYPE_CHECKING:
    from somrs.trust.authority import Authority

trust_app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)
"""The commands of certificates."""

Name = Annotated[str, typer.Argument(help="The name of a device or program, as it publishes itself.")]
Hosts = Annotated[
    list[str], typer.Option("--host", help="A name or IP address at which it is reached; may be repeated.", show_default=False)
]
OutFolder = Annotated[Path, typer.Option("--out", help="The folder for NAME.pem, NAME.key and authority.pem.")]


def _authority(data: Path) -> Authority:
    from somrs.trust.authority import Authority

    return Authority.of_data(data)


def _record(data: Path, act: str, **details: object) -> None:
    """Record an act in the audit log, which is in the data folder as the authority is."""
    from somrs.access.auditor import Auditor, current_actor

    Auditor(data).done(f"trust.{act}", current_actor(), details)


@trust_app.command()
def init(
    site: Annotated[str, typer.Option(help="The name of the site, for people.")] = "site",
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Make the certificate authority of a site, in its data folder."""
    authority = _authority(data)
    guarded(lambda: authority.create(site, _now()))
    _record(data, "init", site=site)
    print(f"made the authority of {site} in {authority.folder}")


@trust_app.command()
def authority(data: Data = DEFAULT_FOLDER) -> None:
    """Print the certificate of the authority, by which a neighbour knows the programs of this site. It is no secret."""
    print(guarded(lambda: _authority(data).public_certificate), end="")


@trust_app.command()
def neighbours(
    file: Annotated[Path, typer.Argument(help="The file of the neighbours, with the `authority` of each.")],
    host: Hosts = [],  # noqa: B006
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Have programs that are started one by one accept the certificates of these neighbours, and of no others."""

    def trusted() -> list[str]:
        from somrs.deployment.neighbours import read_trusted_neighbours

        listed = read_trusted_neighbours(file)
        _authority(data).trust_neighbours(listed, host)
        return [neighbour.name for neighbour in listed]

    names = guarded(trusted)
    _record(data, "neighbours", names=names)
    print(f"certificates of these neighbours count here: {_text(names) or 'none'}")


@trust_app.command(name="list")
def list_certificates(
    with_former: Annotated[bool, typer.Option("--all", help="Those that were revoked or have expired, too.")] = False,
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """Show who has a certificate, and until when."""
    from somrs.client import terminal

    issued, now = guarded(_authority(data).read).certificates, _now().timestamp()
    listed_certificates = [entry for entry in issued if with_former or (entry.revoked_at is None and entry.ends > now)]
    if json:
        terminal.print_json(listed_certificates)
        return
    if not listed_certificates:
        print("nobody has a certificate; `somrs trust invite NAME` invites a device")
    for entry in listed_certificates:
        print(f"{entry.name}: {_text(entry.roles)}, until {_time(entry.ends)}, serial number {entry.serial}{_state(entry.revoked_at)}")
        _print_rights(entry.speaks_for, entry.topics)


@trust_app.command()
def invite(
    name: Name,
    role: Annotated[list[str], typer.Option("--role", help="What it is; may be repeated.")] = ["device"],  # noqa: B006  # typer copies it
    speaks_for: Annotated[
        list[str], typer.Option("--speaks-for", help="A device in whose name it speaks, too; may be repeated.", show_default=False)
    ] = [],  # noqa: B006
    topic: Annotated[
        list[str],
        typer.Option("--topic", help="Topics of MQTT that it may use at the bus, such as 'uagv/v2/ACME/0001/#'; may be repeated."),
    ] = [],  # noqa: B006
    host: Hosts = [],  # noqa: B006
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Let a device or program enrol itself once, within an hour. Prints the word that it needs for that."""
    from somrs.trust.credentials import SERVICE_FILE
    from somrs.trust.identity import Identity, role_named

    def invited() -> str:
        roles, names, topics = frozenset(map(role_named, role)), frozenset(speaks_for), frozenset(topic)
        identity = Identity(name=name, roles=roles, speaks_for=names, topics=topics)
        return _authority(data).invite(identity, _now(), hosts=tuple(host))

    word = guarded(invited)
    _record(data, "invite", name=name, roles=role, speaks_for=speaks_for, topics=topic, hosts=host)
    print(word)
    service = _authority(data).folder / SERVICE_FILE
    if service.exists():
        typer.echo(f"on the computer of {name}: somrs trust enrol {word} --at {service.read_text().strip()}", err=True)


@trust_app.command()
def enrol(
    word: Annotated[str, typer.Argument(help="The word that `somrs trust invite` has printed.")],
    host: Hosts = [],  # noqa: B006
    request: Annotated[
        Path | None,
        typer.Option(help="A certificate request (PEM), of a device that keeps its key; by default, a key is made.", show_default=False),
    ] = None,
    out: OutFolder = Path("."),
    at: Annotated[
        str | None,
        typer.Option(help="The URL of the authority's service, on another computer than that of the authority.", show_default=False),
    ] = None,
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Get the certificate to which a word invites."""
    from somrs.trust.enrolment import enrol

    if at is None:
        written = guarded(lambda: enrol(_authority(data), word, tuple(host), out, _now(), request))
        [certificate] = [path for path in written if path.suffix == ".pem" and path.name != _authority(data).certificate_file.name]
        _record(data, "enrol", name=certificate.stem, hosts=host)
    elif host or request is not None:
        fail("--host and --request are for the computer of the authority; elsewhere, `somrs trust invite --host` names hosts", 2)
    else:
        from somrs.runtime.trust_client import enrol_at

        written = awaited(enrol_at(at, word, out))
    print("\n".join(map(str, written)))


@trust_app.command()
def renew(
    certificate: Annotated[Path, typer.Argument(help="A certificate that still holds. It is replaced, and so is the key beside it.")],
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Get a new key and a new certificate for who has one."""
    from somrs.trust.enrolment import renew

    written = guarded(lambda: renew(_authority(data), certificate, _now()))
    _record(data, "renew", certificate=str(certificate))
    print("\n".join(map(str, written)))


@trust_app.command()
def revoke(name: Name, data: Data = DEFAULT_FOLDER) -> None:
    """Revoke all certificates and invitations of a name."""
    serials = guarded(lambda: _authority(data).revoke(name, _now()))
    _record(data, "revoke", name=name, serials=serials)
    print(f"revoked {_text(serials)}" if serials else f"{name} had an invitation only, which is withdrawn")


@trust_app.command()
def show(
    certificate: Annotated[Path, typer.Argument(help="A certificate (PEM).")],
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Check a certificate, and show whose it is and what it is for."""
    identity = guarded(lambda: _authority(data).check(certificate.read_bytes(), _now()))
    print(f"{identity.name}: {_text(sorted(identity.roles))}")
    _print_rights(sorted(identity.speaks_for), sorted(identity.topics))


def _print_rights(speaks_for: Sequence[str], topics: Sequence[str]) -> None:
    if speaks_for:
        print(f"  speaks for {_text([*speaks_for])}")
    if topics:
        print(f"  by MQTT at {_text([*topics])}")


def _now() -> datetime:
    return datetime.now(UTC)


def _time(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="minutes")


def _text(words: object) -> str:
    assert isinstance(words, tuple | list), "these are names"
    return ", ".join(words)


def _state(revoked_at: float | None) -> str:
    return f", revoked at {_time(revoked_at)}" if revoked_at is not None else ""
