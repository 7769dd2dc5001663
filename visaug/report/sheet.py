"""The data sheet of EMVA 1288 release 4.0 Linear: one HTML file of A4 pages, an operating point after the other."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

from visaug.core.files import write_text
from visaug.report.html import Figure, figure, template
from visaug.report.pages import described
from visaug.report.plots.emva import FIGURES

if TYPE_CHECKING:
    from visaug.characterization import Characterization
    from visaug.characterization.points import OperatingPoint
    from visaug.frames import FrameSet

Row = tuple[str, str, str, float]  # name on the sheet, symbol, key, factor for percent


def _split(release: str, what: str, symbols: bool = True) -> tuple[Row, ...]:
    unit, factor = ("_e", 1) if what == "DSNU" else ("", 100)
    rows = []
    for part, symbol in (("row", "row"), ("column", "col"), ("pixel", "pixel")):
        key = f"{release}.{what.lower()}_{part}{unit}"
        rows.append((f"{what} of {part}s", f"{what}.{symbol}" if symbols else "", key, factor))
    return tuple(rows)


QUANTITIES: dict[str, tuple[Row, ...]] = {  # by heading
    "Sensitivity and noise": (
        ("Quantum efficiency", "η", "emva.quantum_efficiency", 100),
        ("System gain", "K", "emva.system_gain_dn_per_e", 1),
        ("Inverse system gain", "1/K", "emva4.inverse_gain_e_per_dn", 1),
        ("Responsivity", "R", "emva4.responsivity_dn_per_photon", 1),
        ("Temporal dark noise", "σ_d", "emva.dark_noise_e", 1),
        ("Temporal dark noise", "σ_y.dark", "emva.dark_noise_dn", 1),
        ("Abs. sensitivity threshold", "μ_p.min", "emva4.absolute_sensitivity_threshold_photons", 1),
        ("Abs. sensitivity threshold", "μ_e.min", "emva4.absolute_sensitivity_threshold_e", 1),
        ("Saturation capacity", "μ_p.sat", "emva.saturation_photons", 1),
        ("Saturation capacity", "μ_e.sat", "emva.saturation_e", 1),
        ("Signal-to-noise ratio", "SNR max", "emva4.snr_max", 1),
        ("", "", "emva4.snr_max_db", 1),
        ("", "", "emva4.snr_max_bit", 1),
        ("Inverse", "1/SNR max", "emva4.inverse_snr_max", 100),
        ("Dynamic range", "DR", "emva4.dynamic_range", 1),
        ("", "", "emva4.dynamic_range_db", 1),
        ("", "", "emva4.dynamic_range_bit", 1),
    ),
    "Linearity and dark current": (
        ("Linearity error, least", "LE min", "emva.linearity_error_min", 100),
        ("Linearity error, largest", "LE max", "emva.linearity_error_max", 100),
        ("Dark current, mean", "μ_I.mean", "emva.dark_current_mean_e_per_s", 1),
        ("Dark current, variance", "μ_I.var", "emva.dark_current_variance_e_per_s", 1),
        ("Doubling temperature", "T_d", "emva4.doubling_temperature_c", 1),
    ),
    "Spatial non-uniformity": (
        ("DSNU, total", "DSNU 1288", "emva.dsnu_e", 1),
        ("DSNU, total", "", "emva.dsnu_dn", 1),
        *_split("emva4", "DSNU"),
        ("PRNU, total", "PRNU 1288", "emva.prnu_fraction", 100),
        *_split("emva4", "PRNU"),
        ("PRNU, high-pass filtered", "", "emva4.prnu_highpass", 100),
    ),
}
CORRECTED = [row for what in ("DSNU", "PRNU") for row in _split("emva4_corrected", what, symbols=False)]


def write_sheet(path: str | Path, points: Sequence[OperatingPoint], frames: FrameSet) -> Path:
    """Write the sheet: a page of figures and pages of plots for each operating point."""
    content = template("sheet.html").render(
        title="EMVA 1288 data sheet",
        frames=described(frames) + (" of {} x {} pixels".format(*frames.shape(0)) if len(frames) else ""),
        date=datetime.now(timezone.utc).strftime("%Y-%m-%d"),
        points=[_point(point) for point in points],
    )
    write_text(path, content)
    return Path(path)


def sheet_json(points: Sequence[OperatingPoint]) -> dict[str, Any]:
    """The sheet's content for programs: figures with intervals and the arrays of every plot."""
    content = [point.to_json() for point in points]
    return {"schema": 1, "standard": "EMVA 1288 release 4.0 Linear", "operating_points": content}


def _point(point: OperatingPoint) -> dict[str, Any]:
    result = point.result
    tables = [_table(heading, rows, result) for heading, rows in QUANTITIES.items()]
    if any(key in result.parameters for _, _, key, _ in CORRECTED):
        heading = "Split with the temporal noise that rows and columns have"
        tables.append(_table(heading, CORRECTED, result))
    return {
        "name": point.name,
        "tables": tables,
        "defects": [table for what in ("dsnu", "prnu") if (table := _defects(result, what))],
        "open": [
            f"{name}: {needs}" for name, needs in result.not_determined.items() if name.startswith("emva")
        ],
        "warnings": result.warnings,
        "figures": _figures(result),
    }


def _table(heading: str, rows: Sequence[Row], result: Characterization) -> dict[str, Any]:
    made = []
    for name, symbol, key, factor in rows:
        if (e := result.parameters.get(key)) is None:
            if name and key in result.not_determined:
                made.append((name, symbol, "not determined", "", ""))
            continue
        unit = "%" if factor == 100 else "" if e.unit == "1" else e.unit
        interval = f"{_cell(factor * e.low)} to {_cell(factor * e.high)}"
        made.append((name, symbol, _cell(factor * e.value), unit, interval))
    return {"heading": heading, "rows": made}


def _cell(value: float) -> str:
    """Four digits, large ones without exponent."""
    return f"{value:.0f}" if 1e4 <= abs(value) < 1e8 else f"{value:.4g}"


def _defects(result: Characterization, what: str) -> dict[str, Any] | None:
    if (c := result.curves.get(f"emva4_defects_{what}")) is None:
        return None
    unit = "e-" if what == "dsnu" else "%"
    rows = [
        (f"{s:g} σ", f"{limit:.3g} {unit}", str(int(above)), str(int(below)), f"{normal:.2g}")
        for s, limit, above, below, normal in zip(c["sigma"], c["limit"], c["above"], c["below"], c["normal"])
    ]
    filtered = ", after the high-pass filter" if what == "prnu" else ""
    return {"heading": f"{what.upper()}{filtered}: pixels of {int(c['pixels'][0])}", "rows": rows}


def _figures(result: Characterization) -> list[Figure]:
    found = []
    for title, shown, curve, needs, draw in FIGURES:
        there = curve in result.curves and len(next(iter(result.curves[curve].values())))
        if there and all(name in result.parameters for name in needs):
            found.append(figure(draw(result), title, f"{title}. {shown or draw.__doc__}", wide=False))
    return found
