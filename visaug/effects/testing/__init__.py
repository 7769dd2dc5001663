"""The laws that every effect keeps, for effects of one's own: `check_effect` runs them all.

With pytest, one test for each law:

    import pytest
    from visaug.effects.testing import LAWS

    @pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
    def test_law(law):
        law(MyEffect)
"""

from visaug.core.errors import InputError, described
from visaug.effects.checks import check_definition, try_effect
from visaug.effects.effect import Effect
from visaug.effects.testing.laws import LAWS, Law, LawBroken

__all__ = ["LAWS", "Law", "LawBroken", "broken_laws", "check_effect"]


def broken_laws(effect: type[Effect]) -> dict[str, str]:
    """Which laws an effect breaks: name of the law, and what differs.

    Raises:
        InputError: the definition is incomplete, or `apply` fails on a small frame.
    """
    check_definition(effect)
    try_effect(effect)
    broken = {}
    for law in LAWS:
        try:
            law(effect)
        except LawBroken as error:
            broken[law.__name__] = str(error)
        except Exception as error:  # an effect of a user's own may raise anything
            broken[law.__name__] = described(error)
    return broken


def check_effect(effect: type[Effect]) -> None:
    """Runs the laws of effects: it says what it is, the same seed gives the same output, zero strength is identity, a batch
    equals its images, a sequence goes on from batch to batch, a window equals its part of the sensor, moments are as declared,
    gradients agree with differences.

    Args:
        effect: the class.

    Raises:
        InputError: the definition is incomplete, or a law is broken; the message names each broken law.

    Examples:
        >>> from visaug.effects.testing import check_effect
        >>> import visaug
        >>> check_effect(visaug.effects.RowNoise)
    """
    if not (isinstance(effect, type) and issubclass(effect, Effect)):
        problem = f"{effect!r} is no class of an effect"
        raise InputError(problem, expected="for example visaug.effects.RowNoise")
    if broken := broken_laws(effect):
        said = "; ".join(f"{law}: {text}" for law, text in broken.items())
        raise InputError(f"effect {effect.name}: {said}")
