"""One way of looking at a frame set a class."""

from visaug.fingerprint.view import View
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
