"""Problems of planning, as PDDL and the multi-agent MA-PDDL (unfactored) state them, as sites: an ontology, a map, service types,
a device for each agent, and the task. docs/how-to/import-planning-problems.md says what is read.
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
    """What two files say. Raises ModelError with everything that is wrong with them, or that is not read, each with its line."""
    domain_mistakes, mistakes = files.Mistakes(str(domain)), files.Mistakes(str(problem))
    domain_root, root = _root(domain, domain_mistakes), _root(problem, mistakes)
    files.raise_all(domain_mistakes, mistakes)
    assert domain_root is not None
    assert root is not None
    parsed_domain = syntax.domain(domain_root, domain_mistakes)
    return build(parsed_domain, syntax.task(root, mistakes, parsed_domain))


def classical(domain: Path, problem: Path) -> tuple[str, str]:
    """The texts of the two files as ordinary PDDL: agents as first parameters, nothing private."""
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
        raise UsageError(f"{path} cannot be read: {reason}; mend the path or the file") from None
