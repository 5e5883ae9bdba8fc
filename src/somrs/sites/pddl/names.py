"""Converts names between PDDL and Entish. A PDDL name stays as it is written if it is valid in Entish."""

from __future__ import annotations

import re
from collections.abc import Iterable

from somrs.entish.parse import KEYWORDS
from somrs.ontology.files.loading import NAME


class Names:
    """A one-to-one mapping between the PDDL names, in lower case, and the Entish names of one kind (objects, relations, ...)."""

    def __init__(self, reserved: Iterable[str] = ()) -> None:
        self._reserved = set(reserved)
        self._entish: dict[str, str] = {}
        self._pddl: dict[str, str] = {}

    def __contains__(self, pddl: str) -> bool:
        return pddl in self._entish

    def add(self, pddl: str, written: str) -> str:
        """The Entish name of a PDDL name. The first call chooses it from the spelling `written`."""
        if pddl not in self._entish:
            name = self.fresh(written)
            self._entish[pddl] = name
            self._pddl[name] = pddl
        return self._entish[pddl]

    def fresh(self, wanted_name: str) -> str:
        """An unused Entish name, as similar as possible to the wanted one."""
        name = re.sub(r"-(?!\w)", "_", re.sub(r"[^\w-]", "_", wanted_name))
        if not NAME.fullmatch(name):
            name = "x" + name
        while name in self._reserved or name in KEYWORDS:
            name += "_"
        self._reserved.add(name)
        return name

    def entish(self, pddl: str) -> str:
        return self._entish[pddl]

    def pddl(self, entish: str) -> str:
        return self._pddl[entish]
