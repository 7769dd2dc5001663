"""Types of what a config holds: numbers with their limits, and sections."""

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

Share = Annotated[float, Field(ge=0, le=1)]


def ordered(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] > pair[1]:
        raise ValueError(f"expected [low, high], got {list(pair)}")
    return pair


Pair = Annotated[tuple[float, float], AfterValidator(ordered)]  # low, high
Positive = Annotated[float, Field(gt=0, le=1e3)]
Seed = Annotated[int, Field(ge=0, lt=2**31)]  # ultralytics and NumPy take no other
Count = Annotated[int, Field(ge=0, le=100)]
NotNegative = Annotated[float, Field(ge=0, le=1e3)]
SharePair = Annotated[tuple[Share, Share], AfterValidator(ordered)]
PositivePair = Annotated[tuple[Positive, Positive], AfterValidator(ordered)]
Counts = Annotated[tuple[Count, Count], AfterValidator(ordered)]
Amounts = Annotated[tuple[NotNegative, NotNegative], AfterValidator(ordered)]


class ConfigSection(BaseModel):
    """A part of a config; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)
