"""What a user may have meant by a word that is not known."""

from collections.abc import Iterable
from difflib import SequenceMatcher, get_close_matches


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """``"; did you mean a or b?"`` of the nearest known words, at most three; empty where none is near.

    >>> did_you_mean("colum_noise", ["column_noise", "row_noise"])
    '; did you mean column_noise?'
    """
    near = get_close_matches(word, list(known), n=3)
    if not near:
        return ""
    alike = [SequenceMatcher(None, name, word).ratio() for name in near]
    as_near = 0.05  # difference of two similarities (0 to 1) below which neither word is the likelier one
    best = [name for name, ratio in zip(near, alike, strict=True) if ratio >= alike[0] - as_near]
    return f"; did you mean {' or '.join(best)}?"
