"""Whether flats are dark frames plus light, and variance proportional to the signal: what the photon transfer's course tells."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from visaug.characterization.groups import FlatLevel, Measured
from visaug.characterization.photon_transfer import safe_levels, saturated_level
from visaug.statistics.findings import FALSE_ALARM, Findings

FROM_GAIN = ("gain_e_per_dn", "quantum_efficiency", "read_noise.sigma_e", "dsnu.*", "dark_current.*", "full_well_e", "prnu.*",
              "emva.*", "emva4.*", "emva4_corrected.*")  # fmt: skip
# difference in chi square above which one of two models with equally many parameters is preferred
_TELLS = 10.0


@dataclass(frozen=True)
class VarianceFits:
    """Lines through variance against signal: straight through the origin, bent, and lifted."""

    straight: tuple[float, int]  # chi square of the straight line, and its degrees of freedom
    advantage: float = 0.0  # chi square of the bent line less that of the lifted one; 0 of too few levels
    lift: float = 0.0  # intercept of the lifted line in its standard errors
    origin_dn: float = 0.0  # signal at which the lifted line is 0
    intercept_dn2: float = 0.0

    def of_averages(self, dark_dn2: float) -> bool:
        """Whether flats that are averages of several frames, of raw dark frames' variance `dark_dn2`, explain the lift too.
        Averages of m have 1/m of each variance, so that their line lies (1 - 1/m) of the dark variance too low.
        """
        slack = 3.0 * abs(self.intercept_dn2 / self.lift) if self.lift else 0.0  # three standard errors
        return -dark_dn2 - slack <= self.intercept_dn2 <= -dark_dn2 / 2 + slack

    @property
    def deviates(self) -> bool:
        """Whether the straight line is rejected, as a whole or for one that is lifted."""
        value, df = self.straight  # a sound set deviates from the straight line by so much once in 500
        return self.is_lifted or (df > 0 and float(stats.chi2.sf(value, df)) < 0.002)

    @property
    def is_lifted(self) -> bool:
        return abs(self.lift) > float(stats.norm.isf(FALSE_ALARM / 2))

    @property
    def pedestal(self) -> bool:
        """Whether flats have another black level than the dark frames: lifted, and told from bent."""
        return self.is_lifted and self.advantage > _TELLS

    @property
    def undecided(self) -> bool:
        """Whether a bend and a pedestal explain the course about equally well."""
        return self.deviates and abs(self.advantage) <= _TELLS


def course(levels: Sequence[FlatLevel]) -> VarianceFits:
    """Of levels clear of saturation."""
    x = np.array([v.signal for v in levels])
    y = np.array([v.variance_of_all for v in levels])
    errors = np.array([v.variance_error for v in levels])

    def fit(powers: tuple[int, ...]) -> tuple[float, int, np.ndarray, np.ndarray]:
        basis = np.stack([x**p for p in powers], axis=1) / errors[:, None]
        inverse = np.linalg.pinv(basis)
        value = inverse @ (y / errors)
        misfit = float(((basis @ value - y / errors) ** 2).sum())
        return misfit, len(x) - len(powers), value, np.sqrt((inverse**2).sum(1))

    straight = fit((1,))
    if len(x) < 3:
        return VarianceFits(straight[:2])
    bent, lifted = fit((1, 2)), fit((0, 1))
    value, error = lifted[2], lifted[3]
    origin = -value[0] / value[1] if value[1] > 0 else 0.0
    lift, origin, intercept = map(float, (value[0] / error[0], origin, value[0]))
    return VarianceFits(straight[:2], bent[0] - lifted[0], lift, origin, intercept)


def pedestal(measured: Measured, found: Findings) -> bool:
    """Whether flats have another black level than their dark frames; warns of it."""
    levels = measured.sweep
    if not levels or found.warned("bits_missing"):  # whole columns then step by more than their noise
        return False
    chosen = [levels[i] for i in safe_levels(levels, saturated_level(levels), dark_tells=True)]
    if not chosen or not (of := course(chosen)).pedestal:
        return False
    averages = of.of_averages(float(np.median([v.dark.variance for v in chosen])))
    found.warn(
        f"flat_pedestal: the variance of the flats is that of {of.origin_dn:+.3g} DN less signal: their black "
        "level is not that of the dark frames (calibrated already, another offset, or light in the dark frames); "
        "gain_e_per_dn, quantum_efficiency and PRNU are from flats alone"
        + ("; if the flats are averages of several frames, these are wrong too" if averages else ""),
        spoils=("black_level_dn", "dark_current.*", "full_well_e", "emva.*", "emva4.*", "emva4_corrected.*",
                *(FROM_GAIN if averages else ())),
    )  # fmt: skip
    return True


def check_temperature(measured: Measured, found: Findings) -> None:
    """Flats whose dark frames are of another temperature contain a dark signal that is not taken off."""
    other_c = 2.0  # a fifth of the dark current, which doubles every 8 degrees
    apart = [v for v in measured.levels if v.degrees_apart > other_c and v.flat.group.exposure_s > 0]
    if not apart:
        return
    worst = max(apart, key=lambda v: v.degrees_apart)
    found.warn(
        f"dark_temperature: flats at {worst.flat.group.temperature_c:g} degC have dark frames at "
        f"{worst.dark.group.temperature_c:g} degC, so their dark current is counted as light",
        spoils=("quantum_efficiency", "prnu.*", "full_well_e", "emva.quantum_efficiency", "emva.prnu_fraction", "emva4.prnu_*",
                "emva.linearity_error_*", "emva.saturation_*", "emva.system_gain_dn_per_e"),
    )  # fmt: skip
