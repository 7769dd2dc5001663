"""Random camera parameters against SciPy's truncated normal."""

import numpy as np
import pytest
from scipy import stats

from visaug.camera import Camera, draw

COUNT = 20_000


def drawn(path: str, spread, seed: int = 0, **content) -> np.ndarray:
    camera = Camera.load({"resolution": [8, 8], "gain_e_per_dn": 1.0, **content, "randomize": {path: spread}})
    return draw(camera, COUNT, np.random.default_rng(seed))[path].double().numpy()


@pytest.mark.parametrize(
    ("path", "spread", "content", "nominal", "deviation", "low", "high"),
    [
        ("gain_db", {"std": 2.0}, {"gain_db": 3.0}, 3.0, 2.0, -60, 120),
        ("read_noise.sigma_e", 0.2, {"read_noise": {"sigma_e": 2.37}}, 2.37, 0.474, 0, 1e4),
        (
            "read_noise.sigma_e",
            2.0,
            {"read_noise": {"sigma_e": 2.0}},
            2.0,
            4.0,
            0,
            1e4,
        ),  # a third would be negative
        ("read_noise.shape", {"std": 0.3}, {"read_noise": {"shape": -0.23}}, -0.23, 0.3, -0.35, 1),
        ("quantum_efficiency", 0.5, {"quantum_efficiency": 0.9}, 0.9, 0.45, 1e-4, 1),
        ("temperature_c", {"std": 5.0}, {"temperature_c": -10.0}, -10.0, 5.0, -150, 150),
        ("temperature_c", 0.5, {"temperature_c": -10.0}, -10.0, 5.0, -150, 150),  # relative to the size
        ("row_noise.sigma_e", 1.0, {"effects": [{"name": "row_noise", "sigma_e": 1.5}]}, 1.5, 1.5, 0, 1e4),
    ],
)
def test_draws_are_gaussian_and_truncated(path, spread, content, nominal, deviation, low, high):
    """Kolmogorov-Smirnov at 1e-4 for each of 8 cases: a false alarm in 1250 seeds, and the seed is fixed."""
    values = drawn(path, spread, **content)
    law = stats.truncnorm((low - nominal) / deviation, (high - nominal) / deviation, nominal, deviation)
    assert stats.kstest(values, law.cdf).pvalue > 1e-4
    assert low <= values.min()
    assert values.max() <= high


def test_what_has_no_spread_is_nominal_for_every_image():
    camera = Camera.load({"resolution": [8, 8], "gain_e_per_dn": 0.7, "randomize": {"gain_db": {"std": 1}}})
    values = draw(camera, 5, np.random.default_rng(0))
    assert set(values) == set(camera.values())
    assert values["gain_e_per_dn"].tolist() == pytest.approx([0.7] * 5)
    assert values["gain_db"].unique().numel() == 5


def test_a_spread_relative_to_zero_and_a_well_without_bottom_stay():
    content = {"full_well_e": None, "read_noise": {"sigma_e": 0.0}}
    camera = Camera.load(
        {
            "resolution": [8, 8],
            "gain_e_per_dn": 1.0,
            **content,
            "randomize": {"read_noise.sigma_e": 0.2, "full_well_e": 0.1},
        }
    )
    values = draw(camera, 4, np.random.default_rng(0))
    assert values["read_noise.sigma_e"].tolist() == [0.0] * 4
    assert np.isinf(values["full_well_e"].numpy()).all()


def test_a_seed_repeats_its_draws_and_another_does_not():
    first, again, other = (drawn("gain_db", {"std": 1.0}, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert abs(np.corrcoef(first, other)[0, 1]) < 5 / np.sqrt(COUNT)


def test_what_comes_in_whole_numbers_is_rounded():
    """Shares of lost bits against the truncated normal's over half a bit to either side: chi-square at 1e-4."""
    effect = {"name": "bit_truncation", "bits": 2}
    values = drawn("bit_truncation.bits", {"std": 1.5}, effects=[effect])
    law = stats.truncnorm(-2 / 1.5, (15 - 2) / 1.5, 2, 1.5)
    counts = np.bincount(values.astype(int), minlength=16)[:8]
    np.testing.assert_array_equal(values, np.round(values))
    edges = np.array([0, 0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 6.5])
    expected = COUNT * np.diff(law.cdf([*edges, 15]))
    assert stats.chisquare([*counts[:7], COUNT - counts[:7].sum()], expected).pvalue > 1e-4


@pytest.mark.parametrize(
    ("path", "spread", "law"),
    [
        ("gain_db", {"uniform": [-3, 21]}, stats.uniform(-3, 24)),
        ("read_noise.sigma_e", {"log_uniform": [0.5, 40]}, stats.loguniform(0.5, 40)),
        ("gain_db", {"half_normal": 4.0}, stats.halfnorm(2.0, 4.0)),  # from the nominal 2 dB upwards
        (
            "quantum_efficiency",
            {"half_normal": 0.3},
            stats.truncnorm(0, 0.4 / 0.3, 0.6, 0.3),
        ),  # to its bound, 1
    ],
)
def test_other_laws(path, spread, law):
    """Kolmogorov-Smirnov at 1e-4, the seed is fixed."""
    content = {"gain_db": 2.0, "quantum_efficiency": 0.6}
    values = drawn(path, spread, seed=5, **content)
    assert stats.kstest(values, law.cdf).pvalue > 1e-4
    low, high = law.support()
    assert low - 1e-5 <= values.min()
    assert values.max() <= high + 1e-5


def test_correlated_draws_keep_their_laws():
    """The rank correlation of a Gaussian copula is 6/pi asin(r/2); its standard error is about 1/sqrt(N)."""
    laws = {"gain_db": {"uniform": [0, 24]}, "read_noise.sigma_e": 0.1, "quantum_efficiency": {"std": 0.01}}
    pairs = [
        ["gain_db", "read_noise.sigma_e", -0.7],
        ["quantum_efficiency", "prnu.row", 0.9],
    ]  # the last does not vary
    content = {
        "resolution": [8, 8],
        "gain_e_per_dn": 1.0,
        "read_noise": {"sigma_e": 3.0},
        "quantum_efficiency": 0.5,
    }
    camera = Camera.load({**content, "randomize": laws, "correlated": pairs})
    values = {path: v.double().numpy() for path, v in draw(camera, COUNT, np.random.default_rng(2)).items()}
    assert stats.kstest(values["gain_db"], stats.uniform(0, 24).cdf).pvalue > 1e-4
    assert stats.kstest(values["read_noise.sigma_e"], stats.norm(3, 0.3).cdf).pvalue > 1e-4
    expected = 6 / np.pi * np.arcsin(-0.7 / 2)
    found = stats.spearmanr(values["gain_db"], values["read_noise.sigma_e"]).statistic
    assert found == pytest.approx(expected, abs=5 / COUNT**0.5)
    other = stats.spearmanr(values["gain_db"], values["quantum_efficiency"]).statistic
    assert abs(other) < 5 / COUNT**0.5
    assert Camera.load(camera.to_dict()).spec == camera.spec


def test_a_black_level_is_drawn_within_the_converters_range():
    values = drawn("black_level_dn", {"std": 3000.0}, bit_depth=12, black_level_dn=100)
    assert values.max() <= 2048
