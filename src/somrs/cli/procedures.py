"""Handlers of failures and compensations as written on the command line: `[SERVICE TYPE:] EFFECT [WHEN SITUATION]`.

Example: `TransferObject: ?Object isOn Cupboard001 WHEN ?Object isOn Floor001`
"""

from __future__ import annotations

import re

from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.ontology.services import Handler, Occasion

_TYPE = re.compile(r"\s*(?P<name>[^\W\d]\w*(?:-\w+)*)\s*:")
_WHEN_WORD = re.compile(r'"(?:[^"\\\n]|\\.)*"|(?P<when>\bWHEN\b)')


def handler(occasion: Occasion, text: str) -> Handler:
    """The handler that the text describes. Raises FormulaError, with the position in the whole text."""
    typed = _TYPE.match(text)
    start = typed.end() if typed is not None else 0
    words = [match for match in _WHEN_WORD.finditer(text, start) if match["when"] is not None]
    if len(words) > 1:
        raise FormulaError(text, words[1].start(), "there are two WHEN", "join the conditions with AND")
    end = words[0].start() if words else len(text)
    return Handler(
        on=occasion,
        service_type=typed["name"] if typed is not None else None,
        effect=_formula(text, start, end),
        when=_formula(text, words[0].end(), len(text)) if words else None,
    )


def _formula(whole: str, start: int, end: int) -> str:
    text = whole[start:end]
    try:
        parse(text)
    except FormulaError as error:
        raise FormulaError(whole, start + error.position, error.problem, error.hint) from None
    return text.strip()
