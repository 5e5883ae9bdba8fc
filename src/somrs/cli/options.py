"""The options that several commands have, and how a command runs: a mistake of the user's is told in words, without a stack trace."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Coroutine
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from somrs.errors import InputError, SomrsError

Data = Annotated[Path, typer.Option("--data", envvar="SOMRS_DATA", help="The folder of the running system.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON, for programs.")]
HostOption = Annotated[str, typer.Option("--host", help="The address to listen at.")]
PortOption = Annotated[int, typer.Option("--port", help="The port to listen at; 0 takes a free one.")]
Formula = Annotated[str, typer.Argument(help="An Entish formula, such as 'Jar002 isOn Platform001'.")]
DEFAULT_FOLDER = Path(".somrs")
LOOPBACK = "127.0.0.1"


def awaited(main: Coroutine[Any, Any, Any]) -> Any:
    """Run it to its end."""
    return guarded(lambda: asyncio.run(main))


def guarded(run: Any) -> Any:
    """Run it, and end the program where it cannot be done."""
    try:
        return run()
    except InputError as error:
        fail(str(error), 2)
    except SomrsError as error:
        fail(str(error), 1)
    except BrokenPipeError:  # whoever reads what is printed has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except OSError as error:
        if error.filename is None:
            raise
        fail(f"{error.filename}: {error.strerror}", 2)
    except KeyboardInterrupt:
        sys.exit(130)


def fail(text: str, code: int) -> NoReturn:
    typer.echo(text, err=True)
    sys.exit(code)
