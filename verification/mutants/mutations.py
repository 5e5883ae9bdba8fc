"""The mutants of a file: small changes that a test should detect.

The changes are:

* a comparison at its boundary (`<` and `<=`), or negated (`==` and `!=`, `in` and `not in`, `is` and `is not`);
* `and` and `or`, `any` and `all`, `min` and `max`, `break` and `continue`, and operators of arithmetic and of sets, exchanged;
* the condition of an `if`, a `while`, a case or a comprehension negated; a `not` or a minus removed;
* `True` and `False` exchanged, a number increased by one, another string, also in defaults of parameters;
* a statement with an effect removed: a call, a `yield` or `yield from`, an assignment to a value that outlives the function, `del`, `raise`
  and a bare `return`;
* `return None` instead of the returned value.

The following is not changed, because no user could observe it, or because a test would only repeat the code:

* texts for people: docstrings, strings of several words, everything within f-strings and exceptions, `__repr__`, log messages;
* code for type checkers: annotations, `cast`, type variables, code under `TYPE_CHECKING`, `assert`;
* storage options of classes and functions: decorators, `frozen`, `kw_only` and the like, `strict` of `zip`;
* settings: numbers with a name in a module or a class, such as `PATIENCE = 10.0`, and the values of enumeration members. `make
  upgrade-runs` checks that stored values are still understood.
"""

from __future__ import annotations

import ast
import difflib
import re
from dataclasses import dataclass
from pathlib import Path

COMPARISONS: dict[type[ast.cmpop], tuple[str, str]] = {
    ast.Lt: ("<", "<="),
    ast.LtE: ("<=", "<"),
    ast.Gt: (">", ">="),
    ast.GtE: (">=", ">"),
    ast.Eq: ("==", "!="),
    ast.NotEq: ("!=", "=="),
    ast.Is: ("is", "is not"),
    ast.IsNot: (r"is\s+not", "is"),
    ast.In: ("in", "not in"),
    ast.NotIn: (r"not\s+in", "in"),
}
"""The pattern of each operator in the source, and its replacement."""

TURNED = (ast.Eq, ast.NotEq, ast.Is, ast.IsNot, ast.In, ast.NotIn)
"""For these operators the change equals the negation of the whole condition."""

ARITHMETIC: dict[type[ast.operator], tuple[str, str]] = {
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "/"),
    ast.Div: ("/", "*"),
    ast.FloorDiv: ("//", "*"),
    ast.Mod: ("%", "*"),
    ast.Pow: ("**", "*"),
    ast.BitOr: ("|", "&"),
    ast.BitAnd: ("&", "|"),
    ast.BitXor: ("^", "|"),
}

SWAPPED = {"any": "all", "all": "any", "min": "max", "max": "min"}

KEPT_CLASS = frozenset({"frozen", "kw_only", "slots", "gc", "weakref", "dict", "cache_hash", "eq", "order", "total", "omit_defaults"})
ENUMERATIONS = frozenset({"Enum", "StrEnum", "IntEnum"})
"""Keywords of a class that determine its storage, and names of enumeration classes."""

FOR_TYPES = frozenset({"cast", "TypeVar", "NewType", "ParamSpec", "TypeVarTuple"})
NUMBERS = (ast.Constant, ast.UnaryOp, ast.BinOp)
PLAIN = ("str", "int", "float", "bool", "bytes", "object", "type")
GENERIC = ("dict", "list", "set", "tuple", "frozenset")
LITERALS = (ast.Constant, ast.JoinedStr, ast.List, ast.Tuple, ast.ListComp)

WORDS = re.compile(r"\w\s+\S|\S\s+\w")
SIGN = re.compile(rb"not\s*|-\s*")
COMMENT = re.compile(rb"#[^\n]*")


@dataclass(frozen=True)
class Mutant:
    """One change of one file."""

    file: str
    """Relative to the root of the project."""
    line: int
    number: int
    """The number among the mutants of the line, from 1."""
    start: int
    end: int
    """The byte range of the file that is replaced."""
    text: str
    """The replacement."""
    line_range: tuple[int, int] | None
    """The lines that run immediately before the change takes effect; None for code that runs when the module is imported."""

    @property
    def name(self) -> str:
        """The mutant's name for `--only`."""
        return f"{self.file.removeprefix('src/somrs/')}:{self.line}:{self.number}"

    def applied(self, source: bytes) -> bytes:
        return source[: self.start] + self.text.encode() + source[self.end :]

    def diff(self, source: bytes) -> str:
        """Return the changed lines, before and after."""
        lines_before, lines_after = source.decode().splitlines(), self.applied(source).decode().splitlines()
        lines = list(difflib.unified_diff(lines_before, lines_after, lineterm="", n=0))[3:]
        return "\n".join(line[0] + " " + line[1:].strip() for line in lines)


def mutants(file: str, source: bytes) -> list[Mutant]:
    """Return all mutants of a file, from top to bottom."""
    finder = _Finder(source)
    finder.visit(ast.parse(source))
    mutant_list: list[Mutant] = []
    changes: set[tuple[int, int, str]] = set()
    numbers: dict[int, int] = {}
    for start, end, text, line_range in sorted(finder.changes, key=lambda change: change[:3]):
        if (start, end, text) not in changes:
            changes.add((start, end, text))
            line = source.count(b"\n", 0, start) + 1
            numbers[line] = numbers.get(line, 0) + 1
            mutant_list.append(Mutant(file, line, numbers[line], start, end, text, line_range))
    return mutant_list


def all_mutants(root: Path, packages: tuple[str, ...]) -> list[Mutant]:
    """Return the mutants of all modules of these packages of somrs."""
    files = sorted(file for package in packages for file in (root / "src" / "somrs" / package).rglob("*.py"))
    return [mutant for file in files for mutant in mutants(file.relative_to(root).as_posix(), file.read_bytes())]


class _Finder(ast.NodeVisitor):
    """Visits a module, and collects the possible changes with the lines that run them."""

    def __init__(self, source: bytes) -> None:
        self.source = source
        self.changes: list[tuple[int, int, str, tuple[int, int] | None]] = []
        self._starts = [0]
        for line in source.splitlines(keepends=True):
            self._starts.append(self._starts[-1] + len(line))
        self._line_range: tuple[int, int] | None = None
        self._functions: list[str] = []
        self._settings = False
        """Whether this is the value of a name of the module or of a class."""

    # Positions

    def _start(self, node: ast.expr | ast.stmt) -> int:
        return self._starts[node.lineno - 1] + node.col_offset

    def _end(self, node: ast.expr | ast.stmt) -> int:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        return self._starts[node.end_lineno - 1] + node.end_col_offset

    def _add_change(self, start: int, end: int, text: str) -> None:
        if self.source[start:end].decode() != text:
            self.changes.append((start, end, text, self._line_range))

    def _replace_operator(self, left_operand: ast.expr, right_operand: ast.expr, written: str, text: str) -> None:
        """Change the operator between two expressions."""
        start, end = self._end(left_operand), self._start(right_operand)
        gap = COMMENT.sub(lambda comment: b" " * len(comment[0]), self.source[start:end])
        if operator := re.search(written.encode(), gap):
            self._add_change(start + operator.start(), start + operator.end(), text)

    def _turned(self, test: ast.expr) -> None:
        """Negate the condition, unless a change within it is equivalent."""
        is_covered = (
            isinstance(test, ast.Constant)
            or (isinstance(test, ast.UnaryOp) and isinstance(test.op, ast.Not))
            or (isinstance(test, ast.Compare) and len(test.ops) == 1 and isinstance(test.ops[0], TURNED))
        )
        if not is_covered:
            start, end = self._start(test), self._end(test)
            self._add_change(start, end, f"not ({self.source[start:end].decode()})")

    # Statements

    def visit(self, node: ast.AST) -> None:
        if isinstance(node, ast.stmt) and self._functions:
            self._line_range = _lines(node)
        super().visit(node)

    def _remove(self, node: ast.stmt, text: str = "pass") -> None:
        self._add_change(self._start(node), self._end(node), text)

    def visit_Expr(self, node: ast.Expr) -> None:
        match node.value:
            case ast.Constant():  # a docstring, or `...`
                return
            case ast.Yield() | ast.YieldFrom():
                self._remove(node, "yield from ()")  # the function stays a generator
            case ast.Call(func) if _dotted_name(func).startswith("log."):
                return
            case ast.Call() | ast.Await():
                self._remove(node)
        self.generic_visit(node)

    def visit_Assign(self, node: ast.Assign) -> None:
        names = [target.id for target in node.targets if isinstance(target, ast.Name)]
        if "__all__" in names or "__slots__" in names:
            return
        if not names and self._lasting(node.targets):
            self._remove(node)
        self._value(node.value, settings=bool(names))

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self._value(node.value, settings=isinstance(node.target, ast.Name))

    def _value(self, value: ast.expr, *, settings: bool) -> None:
        settings_before, self._settings = self._settings, settings and not self._functions and isinstance(value, NUMBERS)
        self.visit(value)
        self._settings = settings_before

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        self._remove(node)
        if type(node.op) in ARITHMETIC and not isinstance(node.value, LITERALS[1:]):
            written, text = ARITHMETIC[type(node.op)]
            self._replace_operator(node.target, node.value, re.escape(written + "="), text + "=")
        self.visit(node.value)

    def _lasting(self, targets: list[ast.expr]) -> bool:
        """Whether the targets outlive the function. `__init__` is exempt: an attribute that it does not set fails where it is read."""
        lasting = all(isinstance(target, ast.Attribute | ast.Subscript) for target in targets)
        return lasting and bool(self._functions) and self._functions[-1] != "__init__"

    def visit_Delete(self, node: ast.Delete) -> None:
        self._remove(node)
        self.generic_visit(node)

    def visit_Raise(self, node: ast.Raise) -> None:
        if "NotImplementedError" not in ast.dump(node):
            self._remove(node)

    def visit_Assert(self, node: ast.Assert) -> None:
        """Skip it: assertions are for type checkers and readers."""

    def visit_Return(self, node: ast.Return) -> None:
        if node.value is None:
            self._remove(node)
        elif not isinstance(node.value, ast.Constant) or isinstance(node.value.value, str):
            self._add_change(self._start(node.value), self._end(node.value), "None")
        self.generic_visit(node)

    def visit_Break(self, node: ast.Break) -> None:
        self._remove(node, "continue")

    def visit_Continue(self, node: ast.Continue) -> None:
        self._remove(node, "break")

    def visit_If(self, node: ast.If) -> None:
        if _dotted_name(node.test) == "TYPE_CHECKING":
            return
        self._turned(node.test)
        self.generic_visit(node)

    def visit_While(self, node: ast.While) -> None:
        self._turned(node.test)
        self.generic_visit(node)

    def visit_match_case(self, node: ast.match_case) -> None:
        self._line_range = (node.pattern.lineno, max(node.pattern.lineno, node.body[0].lineno - 1)) if self._functions else None
        if node.guard is not None:
            self._turned(node.guard)
        self.generic_visit(node)

    # Functions and classes

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        if node.name == "__repr__":
            return
        line_range_before = self._line_range
        self._line_range = (node.body[0].lineno, node.body[-1].end_lineno or node.body[-1].lineno)
        for default in (*node.args.defaults, *node.args.kw_defaults):
            if default is not None:
                self.visit(default)
        self._functions.append(node.name)
        settings, self._settings = self._settings, False
        for statement in node.body:
            self.visit(statement)
        self._settings = settings
        self._functions.pop()
        self._line_range = line_range_before

    def visit_AsyncFunctionDef(self, node: ast.AsyncFunctionDef) -> None:
        self.visit_FunctionDef(node)  # type: ignore[arg-type]  # has the same parts

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        functions, line_range = self._functions, self._line_range
        self._functions, self._line_range = [], None
        for keyword in node.keywords:
            if keyword.arg not in KEPT_CLASS:
                self.visit(keyword.value)
        enumeration = any(isinstance(base, ast.Name) and base.id in ENUMERATIONS for base in node.bases)
        for statement in node.body:
            if not (enumeration and isinstance(statement, ast.Assign)):
                self.visit(statement)
        self._functions, self._line_range = functions, line_range

    def visit_Lambda(self, node: ast.Lambda) -> None:
        self.visit(node.body)

    # Expressions

    def visit_Compare(self, node: ast.Compare) -> None:
        for left_operand, operator, right_operand in zip([node.left, *node.comparators], node.ops, node.comparators, strict=False):
            self._replace_operator(left_operand, right_operand, *COMPARISONS[type(operator)])
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        written, text = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
        for left_operand, right_operand in zip(node.values, node.values[1:], strict=False):
            self._replace_operator(left_operand, right_operand, written, text)
        self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        types = isinstance(node.op, ast.BitOr) and _is_type(node.left) and _is_type(node.right)
        if type(node.op) in ARITHMETIC and not types and not _literal(node.left) and not _literal(node.right):
            written, text = ARITHMETIC[type(node.op)]
            self._replace_operator(node.left, node.right, re.escape(written), text)
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        if isinstance(node.op, ast.Not | ast.USub) and not self._settings:
            written = SIGN.match(self.source, self._start(node))
            assert written is not None, "it begins with its operator"
            self._add_change(*written.span(), "")
        self.generic_visit(node)

    def visit_IfExp(self, node: ast.IfExp) -> None:
        self._turned(node.test)
        self.generic_visit(node)

    def visit_comprehension(self, node: ast.comprehension) -> None:
        for test in node.ifs:
            self._turned(test)
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        function_name = _dotted_name(node.func)
        if function_name in SWAPPED:
            self._add_change(self._start(node.func), self._end(node.func), SWAPPED[function_name])
        self.visit(node.func)
        for argument in node.args[1:] if function_name in FOR_TYPES else node.args:
            self.visit(argument)
        for keyword in node.keywords if function_name != "zip" else ():
            self.visit(keyword.value)

    def visit_Subscript(self, node: ast.Subscript) -> None:
        self.visit(node.value)
        if not _is_type(node):
            self.visit(node.slice)

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        """Skip it: f-strings are texts for people, and before Python 3.12 their parts have no positions."""

    def visit_Constant(self, node: ast.Constant) -> None:
        match node.value:
            case bool(value):
                text = str(not value)
            case int(value) | float(value) if not self._settings:
                text = repr(value + 1)
            case str(value) if not WORDS.search(value):
                text = '"changed"' if value != "changed" else '""'
            case _:
                return
        self._add_change(self._start(node), self._end(node), text)


def _lines(node: ast.stmt) -> tuple[int, int]:
    """Return the lines of a statement without the statements in it."""
    last_line = node.end_lineno or node.lineno
    inner = [child for child in ast.iter_child_nodes(node) if isinstance(child, ast.stmt | ast.match_case | ast.excepthandler)]
    if inner:
        first = min(child.pattern.lineno if isinstance(child, ast.match_case) else child.lineno for child in inner)
        last_line = max(node.lineno, min(last_line, first - 1))
    return node.lineno, last_line


def _dotted_name(function: ast.expr) -> str:
    return ast.unparse(function) if isinstance(function, ast.Name | ast.Attribute) else ""


def _is_type(node: ast.expr) -> bool:
    """Whether the expression reads as a type: a capitalized name, also with brackets or in a union."""
    match node:
        case ast.Name(name) | ast.Attribute(attr=name):
            return (name[:1].isupper() and (len(name) == 1 or not name.isupper())) or name in PLAIN
        case ast.Subscript(value):
            return _is_type(value) or (isinstance(value, ast.Name) and value.id in GENERIC)
        case ast.BinOp(left_operand, ast.BitOr(), right_operand):
            return _is_type(left_operand) and _is_type(right_operand)
        case ast.Constant(value):
            return value is None
    return False


def _literal(node: ast.expr) -> bool:
    """Whether only `+` is defined for the operand, so that no test is needed for other operators."""
    return isinstance(node, LITERALS) and not (isinstance(node, ast.Constant) and isinstance(node.value, int | float))
