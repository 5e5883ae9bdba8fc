"""Mappings of which a changed copy shares all but what was changed, so that a change of a large map costs what it touches.

A small mapping is a plain dict, which is fastest to read and to copy. A large one is a `PagedDict`: a B-tree of two levels.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import ItemsView, Iterable, Iterator, Mapping, MutableMapping, ValuesView
from typing import Any, TypeVar

K = TypeVar("K")
V = TypeVar("V")

LARGE = 1024
"""A mapping with more entries has pages."""

PAGE = 512
"""Entries in a full page; one with twice as many is cut in two."""


def _in_order(keys: Iterable[K]) -> list[K]:
    return sorted(keys)  # type: ignore[type-var]  # the keys of a mapping can be compared


class PagedDict(MutableMapping[K, V]):
    """A mapping in pages, in the order of its keys. A copy shares the pages, and copies a page when it changes it."""

    __slots__ = ("_count", "_own_pages", "_pages", "_starts")

    def __init__(self, entries: Mapping[K, V]) -> None:
        keys = _in_order(entries)
        self._pages: list[dict[K, V]] = [{key: entries[key] for key in keys[start : start + PAGE]} for start in range(0, len(keys), PAGE)]
        self._starts: list[Any] = keys[PAGE::PAGE]
        """The least key of each page but the first, which has all lesser keys."""
        self._count = len(keys)
        self._own_pages: set[int] = set()
        """The identities of the pages that no copy has."""
        if not self._pages:
            self._pages.append({})

    def copy(self) -> PagedDict[K, V]:
        """A copy. It and this mapping can change independently of each other."""
        copy: PagedDict[K, V] = PagedDict.__new__(PagedDict)
        copy._pages, copy._starts, copy._count, copy._own_pages = [*self._pages], [*self._starts], self._count, set()
        self._own_pages = set()
        return copy

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, key: K) -> V:
        return self._pages[bisect_right(self._starts, key)][key]

    def get(self, key: K, default: Any = None) -> Any:
        return self._pages[bisect_right(self._starts, key)].get(key, default)

    def __contains__(self, key: object) -> bool:
        return key in self._pages[bisect_right(self._starts, key)]

    def __iter__(self) -> Iterator[K]:
        for page in self._pages:
            yield from _in_order(page)

    def items(self) -> ItemsView[K, V]:
        return _Items(self)

    def values(self) -> ValuesView[V]:
        return _Values(self)

    def keys_after(self, key: K) -> Iterator[K]:
        """The keys greater than this one, in order."""
        first = bisect_right(self._starts, key)
        keys: list[Any] = _in_order(self._pages[first])
        yield from keys[bisect_right(keys, key) :]
        for number in range(first + 1, len(self._pages)):
            yield from _in_order(self._pages[number])

    def __setitem__(self, key: K, value: V) -> None:
        number = bisect_right(self._starts, key)
        page = self._own_page(number)
        self._count += key not in page
        page[key] = value
        if len(page) >= 2 * PAGE:
            self._replace_pages(number, number + 1, page)

    def __delitem__(self, key: K) -> None:
        number = bisect_right(self._starts, key)
        if key not in self._pages[number]:
            raise KeyError(key)
        page = self._own_page(number)
        del page[key]
        self._count -= 1
        if len(page) < PAGE // 4 and len(self._pages) > 1:
            number = min(number, len(self._pages) - 2)
            self._replace_pages(number, number + 2, {**self._pages[number], **self._pages[number + 1]})

    def _own_page(self, number: int) -> dict[K, V]:
        page = self._pages[number]
        if id(page) not in self._own_pages:
            page = self._pages[number] = dict(page)
            self._own_pages.add(id(page))
        return page

    def _replace_pages(self, first: int, end: int, entries: Mapping[K, V]) -> None:
        """Put the entries, as one page or as two, in place of some pages."""
        keys = _in_order(entries)
        middle = len(keys) // 2 if len(keys) >= PAGE + PAGE // 2 else len(keys)
        halves = [half for half in (keys[:middle], keys[middle:]) if half]
        self._own_pages.difference_update(map(id, self._pages[first:end]))
        new_pages = [{key: entries[key] for key in half} for half in halves]
        self._pages[first:end] = new_pages
        self._own_pages.update(map(id, new_pages))
        self._starts[first : end - 1] = [half[0] for half in halves[1:]]


class _Items(ItemsView[K, V]):
    _mapping: PagedDict[K, V]

    def __iter__(self) -> Iterator[tuple[K, V]]:
        for page in self._mapping._pages:
            for key in _in_order(page):
                yield key, page[key]


class _Values(ValuesView[V]):
    _mapping: PagedDict[Any, V]

    def __iter__(self) -> Iterator[V]:
        return (value for _, value in self._mapping.items())


def mutable_copy(entries: Mapping[K, V]) -> MutableMapping[K, V]:
    """A copy that can be changed. Pass it to `settled` when it has been changed."""
    return entries.copy() if isinstance(entries, PagedDict) else dict(entries)


def settled(entries: Mapping[K, V]) -> Mapping[K, V]:
    """The mapping in the form for its size.

    So the order of a mapping is what it would be if it were made anew, as when a component restarts: the order in which the entries of a
    small one were added, and the order of the keys of a large one.
    """
    if isinstance(entries, PagedDict):
        return entries if len(entries) > LARGE else dict(entries.items())
    return PagedDict(entries) if len(entries) > LARGE else entries


def changed_keys(before: Mapping[K, V], after: Mapping[K, V]) -> Iterator[K]:
    """The keys that only one of the mappings has, or with another thing in each. Pages that both share are passed over."""
    if before is after:
        return
    old, new = before, after
    if isinstance(before, PagedDict) and isinstance(after, PagedDict):
        old, new = _own_entries(before, after), _own_entries(after, before)
    yield from (key for key, thing in old.items() if key not in new or new[key] is not thing)
    yield from (key for key in new if key not in old)


def _own_entries(entries: PagedDict[K, V], shared_with: PagedDict[K, V]) -> dict[K, V]:
    """The entries in pages that the other mapping does not have."""
    shared = set(map(id, shared_with._pages))
    return {key: value for page in entries._pages if id(page) not in shared for key, value in page.items()}
