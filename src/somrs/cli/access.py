"""The commands about who has access, and who did what: `somrs user`, `somrs token` and `somrs audit`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from somrs.access.rights import PersonRole, Right
from somrs.cli.options import DEFAULT_FOLDER, Data, Json, guarded

user_app = typer.Typer(help="People who may sign in, and what they may do.", no_args_is_help=True, rich_markup_mode=None)
token_app = typer.Typer(help="Tokens, with which programs use the API.", no_args_is_help=True, rich_markup_mode=None)

audit_app = typer.Typer(help="Who changed what, and what was denied to whom.", no_args_is_help=True, rich_markup_mode=None)

PersonName = Annotated[str, typer.Argument(help="The person's name, as it is recorded with what the person does.")]
TokenName = Annotated[str, typer.Argument(help="The token's name, such as that of the program.")]
ROLES = "viewer: sees, and stops devices in an emergency; operator: also tasks, answers and devices; engineer: also maps, ontologies, "
ROLES += "templates and zones; administrator: also people and tokens."


@user_app.command()
def add(
    name: PersonName,
    role: Annotated[PersonRole, typer.Option(help=ROLES)] = PersonRole.OPERATOR,
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Add a person, and print a link to sign in with, once."""
    from somrs.cli.access_commands import add as run

    guarded(lambda: run(name, role, data))


@user_app.command()
def link(name: PersonName, data: Data = DEFAULT_FOLDER) -> None:
    """Print a link with which a person signs in, once, within a day."""
    from somrs.cli.access_commands import link as run

    guarded(lambda: run(name, data))


@user_app.command(name="list")
def list_users(data: Data = DEFAULT_FOLDER, json: Json = False) -> None:
    """List the people, and where they are signed in."""
    from somrs.cli.access_commands import list_users as run

    guarded(lambda: run(data, json=json))


@user_app.command()
def role(name: PersonName, role: Annotated[PersonRole, typer.Argument(help=ROLES)], data: Data = DEFAULT_FOLDER) -> None:
    """Give a person another role. It applies at once."""
    from somrs.cli.access_commands import change_role as run

    guarded(lambda: run(name, role, data))


@user_app.command()
def password(
    name: PersonName,
    is_removed: Annotated[bool, typer.Option("--none", help="Remove the password; the person signs in by links.")] = False,
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Set a person's password, which is asked for. It ends the person's sessions."""
    from somrs.cli.access_commands import set_password as run

    new_password = None if is_removed else typer.prompt("New password", hide_input=True, confirmation_prompt=True)
    guarded(lambda: run(name, new_password, data))


@user_app.command(name="remove-passkeys")
def remove_passkeys(name: PersonName, data: Data = DEFAULT_FOLDER) -> None:
    """Remove all passkeys of a person, as after a loss, and end the person's sessions."""
    from somrs.cli.access_commands import remove_passkeys as run

    guarded(lambda: run(name, data))


@user_app.command()
def remove(name: PersonName, data: Data = DEFAULT_FOLDER) -> None:
    """Remove a person, and end the person's sessions. Records keep the name."""
    from somrs.cli.access_commands import remove as run

    guarded(lambda: run(name, data))


@token_app.command(name="new")
def new_token(
    name: TokenName,
    rights: Annotated[list[Right], typer.Option("--right", help="What it may do; several times for several rights.")] = [Right.SEE],  # noqa: B006  # typer requires a list
    days: Annotated[float, typer.Option(min=0.001, max=3650, help="How long it is valid.")] = 90,
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Make a token, and print it. It is not stored, and so cannot be printed again."""
    from somrs.cli.access_commands import new_token as run

    guarded(lambda: run(name, rights, days, data))


@token_app.command(name="list")
def list_tokens(data: Data = DEFAULT_FOLDER, json: Json = False) -> None:
    """List the tokens: what they may do, and until when."""
    from somrs.cli.access_commands import list_tokens as run

    guarded(lambda: run(data, json=json))


@token_app.command()
def revoke(name: TokenName, data: Data = DEFAULT_FOLDER) -> None:
    """Revoke a token at once."""
    from somrs.cli.access_commands import revoke as run

    guarded(lambda: run(name, data))


@audit_app.command(name="list")
def list_audit(
    count: Annotated[int, typer.Option("--most", min=1, help="How many of the last entries.")] = 50,
    name: Annotated[str, typer.Option("--name", help="Only those of this person or program.")] = "",
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """List the last entries of the audit log, newest last."""
    from somrs.cli.audit_commands import list_audit as run

    guarded(lambda: run(count, name, data, json=json))


@audit_app.command()
def export(
    file: Annotated[Path, typer.Argument(help="The file to write: one JSON object per line.")],
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Write all entries of the audit log to a file."""
    from somrs.cli.audit_commands import export as run

    guarded(lambda: run(file, data))


@audit_app.command()
def verify(
    digest: Annotated[str, typer.Option("--digest", help="A digest that an earlier `verify` printed: its entry must still be there.")] = "",
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Check that no entry of the audit log was altered, removed or put in between."""
    from somrs.cli.audit_commands import verify as run

    guarded(lambda: run(digest, data))


@audit_app.command()
def erase(name: PersonName, data: Data = DEFAULT_FOLDER) -> None:
    """Erase a person's name in the audit log. What was done, and when, stays."""
    from somrs.cli.audit_commands import erase as run

    guarded(lambda: run(name, data))
