"""XML documents from anybody: within limits, and without what a parser could be made to open or to swell."""

from __future__ import annotations

import codecs

from lxml import etree

from somrs.errors import WireError
from somrs.protocol.soap.xml import Element

MOST_BYTES = 256 * 1024
"""The largest document that is read or written."""

MOST_DEPTH = 32
"""The deepest nesting that is read; our own documents need ten."""

SENDER = "env:Sender"
"""The code of a fault that is whoever wrote the document's."""

# In libxml2 all the way: to look at each element from Python takes as long as to parse it.
_too_deep = etree.XPath(f"boolean({'/*' * (MOST_DEPTH + 1)})")


def parse(document: bytes) -> Element:
    """The root element of a document that obeys the limits. Raises WireError.

    The parser opens what a document type declaration names, whatever its options, so it never sees one. To look for it, the
    encoding must be known: it is UTF-8, or UTF-16 with a byte order mark, and the one that is declared does not count.
    """
    if len(document) > MOST_BYTES:
        raise WireError(SENDER, f"the document has {len(document)} bytes, and {MOST_BYTES} are the most")
    try:
        if document[:2] in (codecs.BOM_UTF16_BE, codecs.BOM_UTF16_LE):
            document = document.decode("utf-16").encode()
        if b"<!DOCTYPE" in document:
            raise WireError(SENDER, "a document type declaration is not taken; send the document without one")
        root = etree.fromstring(document, _parser())
    except (etree.XMLSyntaxError, ValueError, LookupError) as error:
        raise WireError(SENDER, f"this is no XML in UTF-8: {str(error)[:200]}") from None
    if _too_deep(root):
        raise WireError(SENDER, f"the document is nested more than {MOST_DEPTH} deep")
    return root


def _parser() -> etree.XMLParser:
    return etree.XMLParser(
        encoding="utf-8",
        resolve_entities=False,
        load_dtd=False,
        no_network=True,
        huge_tree=False,
        remove_comments=True,
        remove_pis=True,
        collect_ids=False,
    )
