"""A camera in plain NumPy, written from the EMVA 1288 model and sharing nothing with the package."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy import stats

from visaug.frames import FrameRecord, FrameSet


@dataclass
class Sensor:
    """True figures under the keys of camera.yaml."""

    rows: int = 48
    columns: int = 64
    quantum_efficiency: float = 0.6
    gain_e_per_dn: float = 0.2
    black_level_dn: float = 300.0
    full_well_e: float = 9000.0
    sigma_e: float = 2.37
    shape: float = -0.23
    a_e_per_s: float = 0.136
    b_per_c: float = 0.14
    prnu: dict = field(default_factory=lambda: {"row": 0.0015, "column": 0.002, "pixel": 0.006})
    dsnu: dict = field(default_factory=lambda: {"row": 0.3, "column": 1.4, "pixel": 1.1})
    top_dn: int = 65535
    row_noise_e: float = 0.0

    def truth(self) -> dict[str, float]:
        return {
            "quantum_efficiency": self.quantum_efficiency,
            "gain_e_per_dn": self.gain_e_per_dn,
            "black_level_dn": self.black_level_dn,
            "full_well_e": self.full_well_e,
            "read_noise.sigma_e": self.sigma_e,
            "read_noise.shape": self.shape,
            "dark_current.a_e_per_s": self.a_e_per_s,
            "dark_current.b_per_c": self.b_per_c,
            **{f"prnu.{k}": v for k, v in self.prnu.items()},
            **{f"dsnu.{k}_e": v for k, v in self.dsnu.items()},
        }

    def expose(self, plan: list[FrameRecord], seed: int) -> FrameSet:
        """The frames of a plan (bias, dark, flat), with this camera's own maps drawn from the seed."""
        rng = np.random.default_rng(seed)
        shape = (self.rows, self.columns)

        def pattern(parts: dict[str, float]) -> np.ndarray:
            return (rng.normal(0, parts["row"], (self.rows, 1)) + rng.normal(0, parts["column"], (1,
            self.columns))
                    + rng.normal(0, parts["pixel"], shape))  # fmt: skip

        prnu, dsnu = pattern(self.prnu), pattern(self.dsnu)
        law = stats.tukeylambda(self.shape)
        frames = []
        for record in plan:
            rate = self.a_e_per_s * np.exp(self.b_per_c * record.temperature_c) * record.exposure_s
            light = (record.photons or 0.0) * self.quantum_efficiency * (1 + prnu)
            charge = np.minimum(
                rng.poisson(np.maximum(light, 0)) + rng.poisson(rate, shape), self.full_well_e
            )
            u = rng.random(shape)
            noise = (u**self.shape - (1 - u) ** self.shape) / self.shape / law.std() * self.sigma_e
            noise += rng.normal(0, self.row_noise_e, (self.rows, 1))
            gain = self.gain_e_per_dn / 10 ** (record.gain_db / 20)
            dn = np.rint(self.black_level_dn + (charge + dsnu + noise) / gain)
            frames.append(np.clip(dn, 0, self.top_dn).astype(np.uint16))
        return FrameSet.from_arrays(plan, frames)


def plan(bias=12, dark=2, flat=2, temperatures=(15.0, 22.0, 30.0), exposures=(0.1, 0.5, 2.0), photons=(200,
1000, 3000,
         6000, 9000, 12000, 17000), gains=()) -> list[FrameRecord]:  # fmt: skip
    records: list[FrameRecord] = []

    def add(count: int, kind: str, exposure_s: float, temperature_c: float, **more) -> None:
        for _ in range(count):
            n = len(records)
            records.append(FrameRecord(n, f"frames.npz#frames[{n}]", kind, exposure_s, temperature_c, **more))

    add(bias, "bias", 1e-5, 20.0)
    for t in temperatures:
        for e in exposures:
            add(dark, "dark", e, t)
    for p in photons:
        add(flat, "flat", 0.01, 20.0, photons=float(p))
    for g in gains:
        add(4, "bias", 1e-5, 20.0, gain_db=float(g))
        for share in (0.2, 0.5):
            add(4, "flat", 0.01, 20.0, gain_db=float(g), photons=round(9000 * share / 10 ** (g / 20)))
    return records
