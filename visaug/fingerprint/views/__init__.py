"""One way of looking at a frame set a class."""

from visaug.fingerprint.view import Unlit, View
from visaug.fingerprint.views.borders import Borders
from visaug.fingerprint.views.codes import Codes
from visaug.fingerprint.views.level import Drift, Level
from visaug.fingerprint.views.memory import Memory
from visaug.fingerprint.views.noise import (
    NoiseCovariance,
    NoiseTails,
    PhotonTransfer,
    PixelNoise,
    TemporalLines,
)
from visaug.fingerprint.views.pattern import Defects, FixedPattern, Seams, SmoothMap
from visaug.fingerprint.views.scene import Scene
from visaug.fingerprint.views.spectrum import FixedSpectrum, TemporalSpectrum

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
