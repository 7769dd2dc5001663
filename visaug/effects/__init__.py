"""Physical effects, one a file, sorted by where in the chain they act.

Every class of the catalogue can be imported from here: `visaug.effects.RowNoise(sigma_e=1.5)(electrons, seed=0)`.
"""

from visaug.effects.catalogue import catalogue, load_file, register, registered
from visaug.effects.effect import Context, Effect, FrameSummary, Stage
from visaug.effects.parameter import Parameter

__all__ = ["Context", "Effect", "FrameSummary", "Parameter", "Stage"]
__all__ += ["catalogue", "load_file", "register", "registered"]


def __getattr__(name: str) -> type[Effect]:
    for effect in catalogue().values():
        if effect.__name__ == name:
            return effect
    raise AttributeError(f"module 'visaug.effects' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *(effect.__name__ for effect in catalogue().values())})
