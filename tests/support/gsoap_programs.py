"""A client and a robot in C++, made with gSOAP from the descriptions that the components of a system serve (`gsoap/`)."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import pytest
import requests

from tests.support.hang import HANG_TIME
from tests.support.paths import ROOT

SOURCES = ROOT / "tests" / "support" / "gsoap"
PLUGINS = Path("/usr/share/gsoap/plugin")
IMPORTS = PLUGINS.with_name("import")
TOOLS = ("wsdl2h", "soapcpp2", "g++", "pkg-config")
NOT_INSTALLED = (
    "a client and a robot made with gSOAP, because it is not installed; on Debian and Ubuntu: "
    "sudo apt-get install gsoap libgsoap-dev libssl-dev zlib1g-dev g++ pkg-config"
)
PROGRAMS = {
    "client": ("soapTaskManagerBindingProxy",),
    "participant": ("soapTaskManagerBindingProxy", "soapRegistryBindingProxy", "soapServiceManagerBindingService"),
}
"""The programs, with the generated files that each needs besides those of all."""


class GsoapPrograms(NamedTuple):
    """The files of the programs; how they are called is in their sources."""

    client: str
    participant: str


def gsoap_programs(cache: Path, session: requests.Session, addresses: Mapping[str, str]) -> GsoapPrograms:
    """The programs, made from the descriptions of components at these addresses; skips the test if gSOAP is not installed.

    `cache`: a folder for programs, where those of the same descriptions and sources are made once.
    """
    if any(shutil.which(tool) is None for tool in TOOLS) or not (PLUGINS / "wsaapi.c").exists():
        pytest.skip(NOT_INSTALLED)
    files = {file.name: file.read_bytes() for file in (*sorted(SOURCES.iterdir()), Path(__file__))}
    for name, address in addresses.items():
        files |= _description(session, name, address)
    version = subprocess.run(["wsdl2h", "-V"], check=True, capture_output=True).stdout
    digest = hashlib.sha256(version + b"".join(name.encode() + content for name, content in files.items())).hexdigest()
    folder = cache / digest[:16]
    if not folder.exists():
        with tempfile.TemporaryDirectory(dir=cache) as temporary:
            _make(Path(temporary), files, tuple(addresses))
            if not folder.exists():  # another worker may have made them
                shutil.copytree(temporary, temporary + ".made", ignore=lambda _, names: {*names} - {*PROGRAMS})
                os.rename(temporary + ".made", folder)
    return GsoapPrograms(*(str(folder / name) for name in GsoapPrograms._fields))


def _description(session: requests.Session, name: str, address: str) -> dict[str, bytes]:
    """The description of a component with its schemas, as files: the generator cannot show a certificate. Without the addresses of this
    system, which the programs get when they start."""
    document = session.get(f"{address}?wsdl", timeout=HANG_TIME).text
    files = {
        f"{schema}.xsd": session.get(f"{address}?xsd={schema}", timeout=HANG_TIME).content
        for schema in re.findall(r"\?xsd=(\w+)", document)
    }
    document = re.sub(rf"{re.escape(address)}\?xsd=(\w+)", r"\1.xsd", document)
    return files | {f"{name}.wsdl": document.replace(address, f"http://somrs.example/{name}").encode()}


def _make(folder: Path, files: Mapping[str, bytes], names: tuple[str, ...]) -> None:
    for name, content in files.items():
        (folder / name).write_bytes(content)
    _run(folder, "wsdl2h", "-t", "typemap.dat", "-o", "somrs.h", *(f"{name}.wsdl" for name in names))
    _run(folder, "soapcpp2", "-2", "-j", "-x", "-L", f"-I{IMPORTS}", "somrs.h")
    flags, libraries = (_run(folder, "pkg-config", option, "gsoapssl++").split() for option in ("--cflags", "--libs"))
    compiled = {"soapC", *PROGRAMS, *(file for needed in PROGRAMS.values() for file in needed)}

    def compile_file(source: str) -> None:
        _run(folder, "g++", *flags, "-DWITH_PURE_VIRTUAL", "-I.", f"-I{PLUGINS}", "-c", source)

    with ThreadPoolExecutor(os.cpu_count()) as threads:
        [*threads.map(compile_file, ("soapC.cpp", str(PLUGINS / "wsaapi.c"), *(f"{name}.cpp" for name in sorted(compiled - {"soapC"}))))]
    for program, needed in PROGRAMS.items():
        objects = [f"{name}.o" for name in (program, "soapC", "wsaapi", *needed)]
        _run(folder, "g++", *objects, "-o", program, *libraries, "-lssl", "-lcrypto", "-lz")


def _run(folder: Path, *command: str) -> str:
    result = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert result.returncode == 0, f"{' '.join(command)}: {result.stdout[-2000:]} {result.stderr[-2000:]}"
    return result.stdout
