"""Where brokers, servers and Modbus devices are, and the files with which one connects to them."""

from __future__ import annotations

import ssl
from pathlib import Path
from urllib.parse import urlsplit

from somrs.adapters.brokers import PORTS as BROKER_PORTS
from somrs.adapters.brokers import read_broker_url
from somrs.adapters.things.mapping import ConnectionEntry
from somrs.adapters.things.model import Connection
from somrs.errors import InputError

PORTS = {**BROKER_PORTS, "http": 80, "https": 443, "modbus": 502}


def parse_connection(name: str, settings: ConnectionEntry, folder: Path = Path()) -> Connection:
    """The connection that an entry describes. `folder`: that of the file with the entry, to which paths of files are relative. Raises
    InputError, also for a file that cannot be used."""
    is_broker = settings.url.startswith(("mqtt://", "mqtts://"))
    parts = urlsplit(settings.url.partition(",")[0] if is_broker else settings.url)
    example = "write mqtt://HOST:1883, http://HOST or modbus://HOST:502/UNIT"
    if parts.scheme not in PORTS or not parts.hostname or not settings.url.isprintable() or " " in settings.url:
        raise InputError(f"{settings.url!r} is not an address of a broker, a server or a Modbus device; {example}")
    try:
        port = parts.port or PORTS[parts.scheme]
    except ValueError:
        raise InputError(f"{settings.url!r} has no valid port; {example}") from None
    try:
        broker = read_broker_url(settings.url) if is_broker else None
    except ValueError as error:
        raise InputError(f"{error}; {example}") from None
    if parts.password is not None or (broker is not None and broker.has_password):
        raise InputError("a password does not belong into an address; write it into a file, and its name as password_file:")
    path = parts.path.rstrip("/")
    unit = path.removeprefix("/") if parts.scheme == "modbus" else ""
    if unit and not (unit.isdigit() and int(unit) <= 255):
        raise InputError(f"{unit!r} is not the number of a Modbus unit: write modbus://{parts.hostname}:{port}/1")
    certificates = settings.certificates
    connection = Connection(
        name=name,
        scheme=parts.scheme,
        host=parts.hostname,
        port=port,
        path="" if parts.scheme == "modbus" else path,
        user=settings.user or parts.username,
        password_file=_file(settings.password_file, folder),
        authority=_file(certificates.authority, folder),
        certificate=_file(certificates.certificate, folder),
        key=_file(certificates.key, folder),
        unit=int(unit or 1),
        further_servers=broker.servers[1:] if broker is not None else (),
    )
    read_password(connection)
    security(connection)
    return connection


def _file(name: str | None, folder: Path) -> str | None:
    """The path of a file that an entry names. Raises InputError if it is not there."""
    if name is None:
        return None
    path = (folder / name).resolve()
    if not path.is_file():
        raise InputError(f"there is no file {path}; correct the name, which is relative to the file in which it is written")
    return str(path)


def read_password(connection: Connection) -> str | None:
    """The password for a connection, without the end of its line. Raises InputError."""
    if connection.password_file is None:
        return None
    try:
        return Path(connection.password_file).read_text("utf-8").rstrip("\r\n")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"the password of {connection.name} cannot be read: {error}") from error


def security(connection: Connection) -> ssl.SSLContext | None:
    """The TLS context for a connection, with the files as they are now; None: it is without TLS. Raises InputError."""
    if connection.scheme not in ("mqtts", "https"):
        return None
    try:
        context = ssl.create_default_context(cafile=connection.authority)
        if connection.certificate is not None:
            context.load_cert_chain(connection.certificate, connection.key)
    except (OSError, ssl.SSLError) as error:
        raise InputError(f"the certificates of {connection.name} cannot be used: {error}") from error
    return context
