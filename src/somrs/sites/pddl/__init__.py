"""Imports planning problems in PDDL and in multi-agent MA-PDDL (unfactored) as sites: an ontology, a map, service types,
a device for each agent, and the task. docs/how-to/import-planning-problems.md lists what is supported.
"""

from __future__ import annotations

from pathlib import Path

from somrs.errors import UsageError
from somrs.sites.pddl import syntax
from somrs.sites.pddl import text as files
from somrs.sites.pddl.classical import classical as without_agents
from somrs.sites.pddl.imported_problem import ImportedProblem, build

__all__ = ["ImportedProblem", "classical", "read"]


def read(domain: Path, problem: Path) -> ImportedProblem:
    """The problem in a domain file and a problem file.

    Raises:
        ModelError: with all mistakes and unsupported features, each with its line.
        UsageError: a file cannot be read.
    """
    domain_mistakes, mistakes = files.Mistakes(str(domain)), files.Mistakes(str(problem))
    domain_root, root = _root(domain, domain_mistakes), _root(problem, mistakes)
    files.raise_all(domain_mistakes, mistakes)
    assert domain_root is not None
    assert root is not None
    parsed_domain = syntax.domain(domain_root, domain_mistakes)
    return build(parsed_domain, syntax.task(root, mistakes, parsed_domain))


def classical(domain: Path, problem: Path) -> tuple[str, str]:
    """The texts of the two files as classical PDDL: agents become first parameters, private parts public. Raises as `read`."""
    mistakes = [files.Mistakes(str(path)) for path in (domain, problem)]
    roots = [_root(path, noted) for path, noted in zip((domain, problem), mistakes, strict=True)]
    files.raise_all(*mistakes)
    first, second = (without_agents(root) if root is not None else "" for root in roots)
    return first, second


def _root(path: Path, mistakes: files.Mistakes) -> files.Group | None:
    try:
        return files.parse(path.read_text("utf-8-sig"), mistakes)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise UsageError(f"{path} cannot be read: {reason}; correct the path or the file") from None
