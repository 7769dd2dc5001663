"""Results by name: what is kept, what is made again, and what makes room."""

from visaug.core.recurrent import Recurrent


def counted(known: Recurrent, names: str, size: int = 1) -> str:
    """Names that were made when they were asked for in this order."""
    made = []
    for name in names:
        known.get(name, lambda name=name: made.append(name) or [name], size)
    return "".join(made)


def test_what_was_asked_for_twice_is_not_made_a_third_time():
    known = Recurrent(10)
    assert counted(known, "aabaab") == "aabb"


def test_what_was_not_asked_for_the_longest_makes_room():
    known = Recurrent(2)
    assert counted(known, "aabbcc") == "aabbcc"  # c takes the room of a
    assert counted(known, "bca") == "a"


def test_what_has_no_room_is_made_each_time():
    assert counted(Recurrent(2), "aaaa", size=3) == "aaaa"
    assert counted(Recurrent(0), "aaaa") == "aaaa"


def test_what_follows_from_kept_results_is_kept_and_nothing_else():
    known = Recurrent(10)
    one, two = (known.get("a", lambda: ["a"], 1) for _ in range(2))
    assert one is not two
    assert known.get("a", list, 1) is two
    first = known.derived("sum", lambda: [0], 1, two, None)
    assert known.derived("sum", lambda: [1], 1, two, None) is first
    assert known.derived("sum", lambda: [1], 1, two) == [1]  # of other sources
    assert known.derived("more", lambda: [2], 1, first) is known.derived("more", lambda: [3], 1, first)
    assert known.derived("sum", lambda: [4], 1, one) == [4]
    assert known.derived("sum", lambda: [5], 1, one) == [5]


def test_what_follows_goes_with_its_sources():
    known = Recurrent(1)
    source = [known.get("a", lambda: ["a"], 1) for _ in range(2)][1]
    known.derived("sum", lambda: [0], 1, source)
    counted(known, "bb")
    assert known.derived("sum", lambda: [1], 1, source) == [1]


def test_what_follows_has_a_limit_of_its_own():
    known = Recurrent(2)
    source = [known.get("a", lambda: ["a"], 2) for _ in range(2)][1]
    first, second = (known.derived(name, lambda: [0], 1, source) for name in "bc")
    assert known.derived("b", lambda: [1], 1, source) is first
    of_first = known.derived("d", lambda: [2], 1, first)  # has no room, and makes some
    assert known.derived("d", lambda: [3], 1, first) == [3] != of_first
    assert known.derived("c", lambda: [4], 1, source) is not second
    assert known.derived("c", lambda: [5], 1, source) == [4]
    assert known.get("a", list, 2) is source
    assert known.derived("e", lambda: [6], 3, source) is not known.derived("e", lambda: [6], 3, source)
