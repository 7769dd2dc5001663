"""One way of looking at a frame set a class."""

from visaug.statistics.view import Unlit, View
from visaug.statistics.views.borders import Borders
from visaug.statistics.views.codes import Codes
from visaug.statistics.views.level import Drift, Level
from visaug.statistics.views.memory import Memory
from visaug.statistics.views.noise import (
    NoiseCovariance,
    NoiseTails,
    PhotonTransfer,
    PixelNoise,
    TemporalLines,
)
from visaug.statistics.views.pattern import Defects, FixedPattern, Seams, SmoothMap
from visaug.statistics.views.scene import Scene
from visaug.statistics.views.spectrum import FixedSpectrum, TemporalSpectrum

VIEWS: tuple[View, ...] = (
    Level(),
    Drift(),
    PhotonTransfer(),
    TemporalLines(),
    TemporalSpectrum(),
    NoiseCovariance(),
    NoiseTails(),
    PixelNoise(),
    FixedPattern(),
    FixedSpectrum(),
    SmoothMap(),
    Seams(),
    Defects(),
    Codes(),
    Memory(),
    Scene(),
)

# Of a large set. A window sees no more of a scene than what lies in it, though light and charge come from all over the sensor.
IN_A_WINDOW: tuple[View, ...] = tuple(view for view in VIEWS if not isinstance(view, Scene))
OF_FULL_FRAMES: tuple[View, ...] = (
    FixedPattern(),
    SmoothMap(),
    Seams(),
    Defects(),
    Borders(),
    Scene(),
)

# Of what the regions of ordinary pictures leave. Of lit ones only what is fine is left, so that some views look at the sky alone.
# Single events and slow changes are left out: they are content there (stars, stray light, exposure).
OF_PICTURES: tuple[View, ...] = (
    Unlit(Level()),
    PhotonTransfer(),
    TemporalLines(),
    TemporalSpectrum(),
    NoiseCovariance(),
    FixedPattern(),
    Unlit(FixedSpectrum()),
    Unlit(Seams()),
    Defects(),
)
