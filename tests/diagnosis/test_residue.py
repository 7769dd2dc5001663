"""The remaining difference is described by its axes and by what it grows with."""

import numpy as np
import pytest

from visaug.diagnosis.residue import BESIDE, WORDS, describe
from visaug.statistics import AXES, Statistic
from visaug.statistics.views.scene import _Key, _target, templates

CONDITIONS = [(exposure, celsius) for exposure in (0.1, 1.0) for celsius in (20.0, 30.0)]


def darks(name: str) -> list[Statistic]:
    return [
        Statistic("defects", name, f"dark {e:g} s {t:g} C", ("pixel",), "1", "dark", e, t)
        for e, t in CONDITIONS
    ]


def grown(values: dict[str, tuple[float, ...]]) -> tuple[str, ...]:
    """What is said to make statistics grow of which each has one value at every condition."""
    statistics = [s for name in values for s in darks(name)]
    return describe(statistics, np.concatenate([np.array(v, float) for v in values.values()])).grows_with


def test_counts_that_are_full_do_not_hide_growth_with_temperature():
    """Hot pixels are all found in the cold already; how far out they are still grows."""
    found = grown({"count": (2, 11, 11, 11.2), "variance": (3, 9, 20, 40), "skewness": (1, 4, 12, 19)})
    assert found == ("exposure", "temperature")


@pytest.mark.parametrize("warm", [1.0, 0.9, 1.1])
def test_a_glow_that_no_temperature_changes(warm):
    assert grown({n: (1, 1, 20 + i, warm * (20 + i)) for i, n in enumerate("abcd")}) == ("exposure",)


@pytest.mark.parametrize(
    ("excess", "time", "said"),
    [
        ((9.5, 35.1, 240.0, 840.0), False, ("exposure", "temperature")),
        ((9.5, 9.0, 240.0, 250.0), False, ("exposure",)),  # pixels that gather light from an amplifier
        ((9.8, 0.1, 0.4, 1.2), False, ("exposure",)),  # by turns
        (
            (9.5, 35.1, 240.0, 840.0),
            True,
            ("exposure",),
        ),  # tracks, of which the warm frames happen to have more
    ],
)
def test_the_excess_of_a_pattern_tells_its_growth_with_temperature(excess, time, said):
    """The logarithm of a variance that is a thousand times too large hardly answers in standard deviations."""
    statistics = [
        Statistic(
            "fixed_pattern", "pixels", s.frames, ("pixel",), "log DN^2", "dark", s.exposure_s, s.temperature_c
        )
        for s in darks("pixels")
    ]
    view = ("time",) if time else ("pixel",)
    noise = [
        Statistic("noise_tails", f"beyond {k}", "dark 1 s 20 C", view, "1", "dark", 1.0, 20.0) for k in (3, 5)
    ]
    z = np.array([92.0, 98.0, 480.0, 490.0, 300.0, 290.0])
    found = describe([*statistics, *noise], z, excess=np.array([*excess, 1.0, 1.0]))
    assert found.grows_with == said
    assert describe([*statistics, *noise], z).grows_with == ("exposure",)


def test_what_is_measured_on_all_dark_frames_together_tells_no_growth():
    """Codes are counted over all dark frames, under the name of the longest."""
    statistics = [
        Statistic("codes", f"bit {i}", "dark 1 s 30 C", ("level",), "share", "dark", 1.0, 30.0)
        for i in range(4)
    ]
    statistics += darks("variance")
    assert describe(statistics, np.array([500.0, 400, 300, 200, 20, 21, 20, 19])).grows_with == ()


def flats(z: list[float], frames: float = 0.0) -> tuple[str, ...]:
    """The axes told where the means of flats of rising level are so far off, and the spread of bias frames."""
    statistics = [
        Statistic("level", "mean", f"flat {i}", ("level",), "DN", "flat", 0.01, 20.0, signal=100.0 * i)
        for i in range(len(z))
    ]
    spread = Statistic("drift", "bias frames", "bias", ("time",), "1", "bias")
    return describe([*statistics, spread], np.array([*z, frames])).axis


def test_levels_that_are_off_by_turns_wander_in_time():
    assert "time" in flats([40, -50, 112, -48, 139, -60])


def test_levels_wander_in_time_where_frames_of_one_condition_do():
    levels = [-83, -26, -26, -24, -23]  # a law of the level, for all that they tell
    assert flats(levels) == ("level",)
    assert flats(levels, frames=-6) == ("level",)  # steadier than expected
    assert flats(levels, frames=12) == ("time", "level")


def test_a_response_that_bends_is_a_matter_of_the_level():
    """What a bend leaves beside a refitted line changes its sign twice."""
    assert flats([40, 20, -15, -30, -20, 10, 45]) == ("level",)
    assert flats([40, -50, 112]) == ("level",)  # too few to tell


def test_columns_that_only_light_shows_grow_with_the_signal():
    """Odd columns with a gain of their own: two numbers of a hundred, and nothing in the bias."""

    def of(name: str, kind: str) -> Statistic:
        return Statistic("seams", name, f"{kind} frames", ("column",), "DN", kind)

    names = ["odd against even columns", "columns, peak", *(f"other {i}" for i in range(100))]
    statistics = [of(name, kind) for kind in ("bias", "flat") for name in names]
    quiet = [0.5] * 100
    assert describe(statistics, np.array([0.5, 1.0, *quiet, 9.7, 15.1, *quiet])).grows_with == ("signal",)
    assert describe(statistics, np.array([9.0, 14.0, *quiet, 9.7, 15.1, *quiet])).grows_with == ()


def along(*told: tuple[str, str, float]) -> tuple[str, ...]:
    """The axes told where statistics of (view, axes, standard deviations) stay."""
    statistics = [
        Statistic(view, f"s{i}", "bias", tuple(axes.split())) for i, (view, axes, _) in enumerate(told)
    ]
    return describe(statistics, np.array([z for *_, z in told])).axis


def test_the_axis_of_the_furthest_statistic_comes_first_however_many_views_show_another():
    glow = [("smooth_map", "smooth", 260.0), ("level", "level", 202.0), ("fixed_spectrum", "column", 15.6)]
    assert along(*glow, ("fixed_spectrum", "row", 13.3), ("spectrum", "row", 13.0)) == ("smooth", "level")


def test_noise_along_rows_is_told_along_time_and_row():
    assert set(along(("temporal_lines", "time row", 98.0), ("fixed_pattern", "row", 26.0))) == {"time", "row"}


def test_codes_are_told_only_where_little_else_is_off():
    """Whatever moves a pixel moves its code: a step between columns is no matter of the level."""
    assert along(("codes", "level", 15.6), ("seams", "column", 10.6)) == ("column",)
    assert along(("codes", "level", 700.0), ("pixel_noise", "time pixel", 9.5)) == ("level",)


def test_the_remaining_difference_is_described_in_words():
    statistics = [Statistic("scene", axis, "bias", (axis,)) for axis in ("row", "smooth", "level")]
    assert describe(statistics, np.array([9.0, 8.0, 7.0]), "smear").description == (
        "The remaining difference varies from row to row, smoothly over the sensor and with the level, and does not clearly grow "
        "with signal, exposure or temperature. The largest deviation is row of bias (scene), by 9.0 standard deviations. "
        "smear reduces the error but does not explain it."
    )
    assert describe(statistics, np.array([9.0, 8.0, 7.0]), "dark_current_rts").description.endswith(
        " dark_current_rts reduces the error but does not explain it, or only without what sets it apart from hot_pixels."
    )
    assert set(WORDS) == set(AXES)


@pytest.mark.parametrize(("dark", "grows"), [(3.0, ("signal",)), (10.0, ())])
def test_a_step_that_moves_few_levels_grows_with_the_signal(dark, grows):
    """Two of sixty statistics with light are off, and none without, or one as well."""
    lit = [Statistic("level", f"s{i}", "flat", ("level",), "DN", "flat", 0.01, 20.0) for i in range(60)]
    unlit = [Statistic("level", f"s{i}", "bias", ("level",), "DN", "bias") for i in range(60)]
    z = np.ones(120)
    z[:2], z[60] = (14.8, 9.3), dark
    assert describe([*lit, *unlit], z).grows_with == grows


def shared_noise(**z: float) -> tuple[str, ...]:
    """The axes told where correlations of bias frames' noise, and of a mean frame's pattern, stay."""
    noise = [
        Statistic("noise_covariance", name.replace("_", " "), "bias", ("time", "pixel"))
        for name in z
        if name != "pattern"
    ]
    pattern = Statistic("fixed_pattern", "one column on", "dark 0.1 s 20 C", ("pixel",))
    return describe(
        [*noise, pattern], np.array([*(x for name, x in z.items() if name != "pattern"), z["pattern"]])
    ).axis


def test_stripes_are_no_matter_of_single_pixels():
    """A sine of 25 px along the readout, of any phase in each row, is nearly the same for the next two columns."""
    along_rows = {
        "one_column_on": 66.0 * np.cos(2 * np.pi / 25),
        "two_columns_on": 66.0 * np.cos(4 * np.pi / 25),
    }
    assert set(shared_noise(**along_rows, one_row_on=1.0, two_rows_on=-8.0, pattern=29.0)) == {"time", "row"}


def test_noise_that_both_ways_share_varies_slowly_over_the_sensor():
    fringes = {"one_row_on": 25.0, "two_rows_on": 23.0, "one_column_on": 25.0, "two_columns_on": 23.0}
    assert shared_noise(**fringes, pattern=50.0)[0] == "smooth"


def test_charge_that_spreads_to_the_next_pixel_is_a_matter_of_pixels():
    """A kernel with arms two pixels long, the second a third of the first, shares a third as much with the second pixel."""
    spread = {"one_column_on": 60.0, "two_columns_on": 20.0, "one_row_on": 60.0, "two_rows_on": 20.0}
    assert "pixel" in shared_noise(**spread, pattern=100.0)
    assert "smooth" not in shared_noise(**spread, pattern=100.0)


@pytest.mark.parametrize(
    ("place", "z", "axis"),
    [
        ("1 to 2", (-27.0, -24.0), "pixel"),
        ("9 to 30", (27.0, 24.0), "smooth"),
        ("1 to 2", (27.0, 2.0), "row"),
        ("1 to 2", (27.0, -24.0), "row"),
    ],
)
def test_what_spreads_all_around_bright_spots_is_no_matter_of_rows_or_columns(place, z, axis):
    rings = [
        Statistic("scene", f"{place} px from bright spots along the {line}", "scene spot", (line,))
        for line in ("row", "column")
    ]
    assert describe(rings, np.array(z)).axis[0] == axis


def test_the_rings_that_may_be_alike_are_the_views():
    """A ring renamed there would be told by its line again."""
    clean = np.zeros((96, 96))
    clean[40:44, 50:54] = 1e4
    names = {*_target(_Key(clean)).rings, *templates(clean, np.ones_like(clean))}
    assert {shape.format(line) for shape in BESIDE for line in ("row", "column")} <= names
