"""Checks of the measurement model: what each tests, how often a sound set sounds it, and the words it warns with.

The model: a frame is a linear function of independent Poisson electrons plus independent noise of constant law, one
sensor, one black level. Every check is a statistic with a stated false-alarm rate and says which parameters it spoils.
`screened` tests the pixels before frames are averaged, and leaves out what no model describes; `tested` tests what the
groups of frames tell. Both run before any figure is found.
"""

from dataclasses import dataclass

from visaug.characterization import additivity, codes, defective, exchangeable, in_time, neighbours
from visaug.characterization.alike import merged_groups
from visaug.characterization.facts import Facts, look
from visaug.characterization.groups import Measured
from visaug.frames import FrameSet
from visaug.statistics.findings import Findings


@dataclass(frozen=True)
class ModelCheck:
    """One assumption of the model, the probability that a sound set is warned about, and the words of its warnings."""

    assumption: str
    false_alarms: float
    words: tuple[str, ...]


CHECKS = (
    ModelCheck("every pixel answers to light", 0.001, ("stuck_pixels", "overscan")),
    ModelCheck("one step of the converter is 1 DN", 0.001, ("code_gaps", "bits_missing")),
    ModelCheck("frames of a group differ by noise alone", 0.01,
               ("stale_frame", "cosmic_rays", "lamp_band", "frames_dependent")),
    ModelCheck("the noise of neighbours is independent", 0.005, ("correlated_noise",)),
    ModelCheck("variance is proportional to the signal", 0.006,
               ("photon_transfer_bent", "photon_transfer_scattered")),
    ModelCheck("all pixels have one gain", 0.002, ("gain_uneven",)),
    ModelCheck("flats are dark frames plus light", 0.001, ("flat_pedestal", "dark_temperature")),
    ModelCheck("dark current grows as silicon's", 0.001, ("dark_current_flat",)),
    ModelCheck("the response is even or white", 0.005, ("periodic_response", "structured_light")),
    ModelCheck("headers agree with pixels", 0.001,
               ("mosaic_contradicted", "photons_contradicted", "photons_implausible", "lossy_frames")),
)  # fmt: skip


def screened(frames: FrameSet, facts: list[Facts], found: Findings) -> tuple[FrameSet, list[Facts]]:
    """The frames without stale ones, columns and rows that see no light, stuck pixels and cosmic rays."""
    frames, facts = in_time.without_stale(frames, facts, merged_groups(frames, facts), found)
    groups = merged_groups(frames, facts)
    if (seen := defective.extremes(frames, facts, groups)) is None:
        return frames, facts
    codes.check(seen, found)
    if (window := defective.lit_window(frames, seen, found)) is not None:
        found.lit = window
        frames, seen = defective.cut(frames, seen, window)
        facts = look(frames)
    if (stuck := defective.stuck_pixels(seen, found)) is not None:
        frames = defective.without(frames, stuck)
    return in_time.without_hits(frames, groups, found), facts


def tested(measured: Measured, found: Findings) -> Measured:
    """The groups with what neighbours share and what a lamp's bands add; warnings of what spoils a figure."""
    measured = neighbours.with_covariances(measured, found)
    if not found.filtered:
        exchangeable.check(measured, found)
        measured = in_time.without_bands(measured, found)
    additivity.check_temperature(measured, found)
    return measured
