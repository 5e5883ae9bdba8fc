"""Parse untrusted XML documents: with limits on size and depth, without DTDs, external entities and network access."""

from __future__ import annotations

import codecs

from lxml import etree

from somrs.errors import WireError
from somrs.protocol.soap.xml import Element

MOST_BYTES = 256 * 1024
"""The largest document that is read or written."""

MOST_DEPTH = 32
"""The deepest nesting that is read; SO-MRS itself needs ten levels."""

SENDER = "env:Sender"
"""The fault code for an error of the document's author."""

# libxml2 checks the depth: visiting each element from Python takes as long as parsing the document.
_too_deep = etree.XPath(f"boolean({'/*' * (MOST_DEPTH + 1)})")


def parse(document: bytes) -> Element:
    """Return the root element of a document within the limits.

    The parser opens what a document type declaration names, whatever its options, so documents with one are refused before parsing. To find
    a declaration, the encoding must be known: UTF-8, or UTF-16 with a byte order mark; a declared encoding is ignored.

    Raises:
        WireError: the document exceeds a limit, has a document type declaration, or is not well-formed.
    """
    if len(document) > MOST_BYTES:
        raise WireError(SENDER, f"the document has {len(document)} bytes; the limit is {MOST_BYTES}")
    try:
        if document[:2] in (codecs.BOM_UTF16_BE, codecs.BOM_UTF16_LE):
            document = document.decode("utf-16").encode()
        if b"<!DOCTYPE" in document:
            raise WireError(SENDER, "a document type declaration is not allowed; send the document without one")
        root = etree.fromstring(document, _parser())
    except (etree.XMLSyntaxError, ValueError, LookupError) as error:
        raise WireError(SENDER, f"this is not well-formed XML in UTF-8: {str(error)[:200]}") from None
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
