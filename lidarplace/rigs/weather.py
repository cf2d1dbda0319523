"""Extinction of the light of a LiDAR by fog and rain, and the distance that is left to see."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidarplace.base.errors import InputError

KOSCHMIEDER = -math.log(0.02)  # optical depth where a black object has 2 % of contrast left: 3.912
GREEN_M = 550e-9  # wavelength for which a visibility is meant, metres


@dataclass(frozen=True)
class Weather:
    """Fog and rain, the same everywhere around the vehicle."""

    visibility: float = math.inf
    """Distance in fog or haze at which a black object is visible against the sky (2 % of contrast),
    metres; infinite for clear air."""
    rain: float = 0.0  # rate, millimetres an hour

    def __post_init__(self) -> None:
        if not self.visibility > 0:
            raise InputError(key="visibility", expected="more than 0 m", found=self.visibility)
        if not 0 <= self.rain < math.inf:
            raise InputError(key="rain", expected="a finite number >= 0", found=self.rain)

    def __str__(self) -> str:
        fog = [f"visibility {self.visibility:g} m"] if self.visibility < math.inf else []
        rain = [f"rain {self.rain:g} mm/h"] if self.rain else []
        return ", ".join(fog + rain) or "clear air"

    def extinction(self, wavelength: float) -> float:
        """Return the rate at which light of a wavelength, metres, is lost in fog and rain, 1/m."""
        return fog_extinction(self.visibility, wavelength) + rain_extinction(self.rain)


def fog_extinction(visibility: float, wavelength: float) -> float:
    """Return the extinction of fog by Koschmieder's law, 1/m, with Kim's exponent.

    3.912 / V (wavelength / 550 nm)^-q of visibility V, metres; q is 0 in fog of less than 500 m,
    where all wavelengths fade alike (Kim, McArthur and Korevaar 2001, Proc. SPIE 4214, after Kruse
    1962)."""
    kilometres = visibility / 1000.0
    if kilometres > 6.0:
        exponent = 1.6 if kilometres > 50.0 else 1.3
    elif kilometres > 1.0:
        exponent = 0.16 * kilometres + 0.34
    else:
        exponent = max(kilometres - 0.5, 0.0)
    return KOSCHMIEDER / visibility * math.pow(wavelength / GREEN_M, -exponent)


def rain_extinction(rain: float) -> float:
    """Return the extinction of rain, in millimetres an hour, at any wavelength of LiDARs, 1/m.

    It is twice the cross-section of all drops in a cubic metre: drops are far larger than the
    wavelength, so each takes twice the light that falls on it. Of D millimetres there are
    8000 exp(-4.1 rain^-0.21 D) in a cubic metre and millimetre of diameter (Marshall and Palmer
    1948, J. Meteorol. 5, 165), which makes 0.000365 rain^0.63."""
    # 2 pi/4 times the integral of D^2 N(D), which is 2 * 8000 / slope^3; square millimetres.
    return 1e-6 * math.pi * 8000.0 / 4.1**3 * math.pow(rain, 0.63)


def shortened(distance: ArrayLike, fading: float) -> NDArray[np.float64]:
    """Return the R with `R exp(fading R) = distance`, metres, right to 15 digits.

    By Lambert's W, R = W(fading distance) / fading. W(x) is Wright's omega of ln x, which neither
    overflows nor needs an iteration of ours. Distances, metres, and fading, 1/m, are not negative;
    infinite distances stay so."""
    clear = np.asarray(distance, np.float64)
    if fading == 0.0:
        return clear
    from scipy.special import wrightomega  # slow, and clear air does without

    with np.errstate(divide="ignore", invalid="ignore"):  # ln 0, and infinity times 0
        depth = wrightomega(math.log(fading) + np.log(clear))
        # W = x exp(-W): of little depth the quotient would be one of numbers near 0.
        return np.where(
            depth < 1.0, clear * np.exp(-depth), np.where(np.isinf(clear), clear, depth / fading)
        )
