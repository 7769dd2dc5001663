"""Physical effects, one a file, sorted by where in the chain they act."""

from visaug.effects.catalogue import catalogue, load_file, register
from visaug.effects.effect import Context, Effect, Look, Parameter, Stage

__all__ = ["Context", "Effect", "Look", "Parameter", "Stage", "catalogue", "load_file", "register"]
