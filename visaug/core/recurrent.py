"""A cache of results, bounded in memory."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any


class Recurrent:
    """Keeps results by name. What was asked for twice is kept for the third time, so that what is needed once takes no room.

    Args:
        most: bytes of results that are kept at most; what was not asked for the longest makes room. As many again are kept of
            what is derived of them.

    Examples:
        >>> known = Recurrent(most=1000)
        >>> [known.get("number", lambda: n, 8) for n in range(4)]
        [0, 1, 1, 1]
    """

    def __init__(self, most: int):
        self._most = self._left = self._left_derived = most
        self._asked: set[Hashable] = set()
        self._kept: OrderedDict[Hashable, tuple[Any, int]] = OrderedDict()
        # with the sources, so that their identities stay theirs
        self._derived: dict[Hashable, tuple[Any, tuple]] = {}
        self._known: set[int] = set()  # identities of all that is kept

    def get(self, name: Hashable, make: Callable[[], Any], size: int) -> Any:
        """The result of this name, made where it is not kept.

        Args:
            size: bytes of it.
        """
        if name in self._kept:
            self._kept.move_to_end(name)
            return self._kept[name][0]
        result = make()
        if name in self._asked and size <= self._most:
            while size > self._left:
                self._left += self._kept.popitem(last=False)[1][1]
                self._drop_derived()
            self._left -= size
            self._kept[name] = result, size
            self._known.add(id(result))
        self._asked.add(name)
        return result

    def derived(self, name: Hashable, make: Callable[[], Any], size: int, *sources: Any) -> Any:
        """The result of this name that follows from its sources alone; kept where all of these are. A source may be None.

        Args:
            size: bytes of it, without its sources.
        """
        if not all(source is None or id(source) in self._known for source in sources):
            return make()
        name = (name, *map(id, sources))
        if name not in self._derived:
            result = make()
            if size > self._left_derived:
                self._drop_derived()  # with sources that are derived themselves
                return result
            self._left_derived -= size
            self._derived[name] = result, sources
            self._known.add(id(result))
        return self._derived[name][0]

    def _drop_derived(self) -> None:
        self._derived, self._left_derived = {}, self._most
        self._known = {id(one) for one, _ in self._kept.values()}
