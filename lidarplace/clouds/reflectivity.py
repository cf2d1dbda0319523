"""Reflectivities of materials at 905 nm: one table, and draws from it.

A reflectivity is that of an ideal white diffuser times so much: 1 sends all light back, spread as
Lambert's law says. Retroreflectors send it back to where it came from and have far more than 1; the
intensity of a point ends at 1."""

import hashlib
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray


class Material(IntEnum):
    """Materials of surfaces in a simulated scene."""

    PAINT = 0
    """Paint of cars, trucks and two-wheelers."""
    GLASS = 1
    """The windows of a car: light passes and gets lost behind them."""
    TYRE = 2
    """Tyres, and other black rubber and plastic."""
    RETROREFLECTOR = 3
    """Licence plates, reflectors of vehicles and traffic signs."""
    LAMP = 4
    """Head and tail lamps, which reflect to the source in part."""
    CLOTHES = 5
    SKIN = 6
    """Skin and hair."""
    WALL = 7
    """Walls of buildings: brick, concrete, wood, plaster and glass."""
    ASPHALT = 8
    PAVING = 9
    """Concrete and stone on the ground."""
    GRASS = 10
    MARKING = 11
    """Marks on roads, with glass beads."""


REFLECTIVITY: dict[Material, tuple[tuple[float, float], ...]] = {
    Material.PAINT: ((0.0, 0.03), (0.19, 0.06), (0.38, 0.2), (0.55, 0.4), (0.65, 0.55), (1.0, 0.8)),
    Material.TYRE: ((0.0, 0.02), (1.0, 0.1)),
    Material.RETROREFLECTOR: ((0.0, 0.4), (0.1, 2.0), (0.5, 100.0), (1.0, 300.0)),
    Material.LAMP: ((0.0, 0.1), (0.5, 0.6), (0.8, 3.0), (1.0, 30.0)),
    Material.CLOTHES: ((0.0, 0.05), (0.2, 0.2), (0.6, 0.5), (1.0, 0.8)),
    Material.SKIN: ((0.0, 0.3), (0.5, 0.5), (1.0, 0.65)),
    Material.WALL: ((0.0, 0.05), (0.2, 0.15), (0.5, 0.3), (0.8, 0.5), (1.0, 0.85)),
    Material.ASPHALT: ((0.0, 0.06), (0.3, 0.12), (1.0, 0.3)),
    Material.PAVING: ((0.0, 0.2), (0.5, 0.35), (1.0, 0.5)),
    Material.GRASS: ((0.0, 0.25), (0.5, 0.45), (1.0, 0.6)),
    Material.MARKING: ((0.0, 0.5), (0.3, 1.5), (1.0, 6.0)),
}
"""Quantiles of the reflectivity of every material, as pairs (share of all surfaces, reflectivity
which that share does not exceed), linear between them. The values of PAINT were read in the works
named there. The other ranges are commonly quoted from the works below, rounded, and were not
checked against their tables; few state how often a value occurs, so the shares between are
estimates.

PAINT. Pigments with carbon black absorb the near infrared too: black cars reflect some 5 %, white
and silver ones some 60 % (Levinson, Pan, Ban-Weiss, Rosado, Paolini, Akbari, *Potential benefits of
solar reflective car shells: cooler cabins, fuel savings and emission reductions*, Applied Energy,
2011; at 905 nm: Lim, Bae, Yu, Baek, Cho, *Near-infrared reflective dark-tone bilayer system for
LiDAR-based autonomous vehicles*, Macromolecular Research, 2022). How many cars are white (35 %),
black (19 %), grey (19 %), or else: Axalta, *Global automotive color popularity report*, 2021.
TYRE, CLOTHES. Muckenhuber, Holzer, Bockaj, *Automotive lidar modelling approach based
on material properties and lidar capabilities*, Sensors, 2020, and the measurements at 945 nm
that followed: Ritter and others, *Angle-dependent spectral reflectance material dataset based on
945 nm time-of-flight camera measurements*, Data in Brief, 2023.
RETROREFLECTOR. Signs of class RA1 to RA2 send back 70 to 250 cd per lux and square metre, plates
at least some 50: pi times that in terms of a white diffuser, less where they are dirty or the beam
meets them in part (EN 12899-1, *Fixed, vertical road traffic signs*, 2007; ISO 7591,
*Retro-reflective registration plates for motor vehicles and trailers*, 1982).
LAMP. Estimated, between plastic and a retroreflector, which tail lamps hold.
SKIN. Cooksey, Allen, Tsai, *Reference data set of human skin reflectance*, Journal of Research of
NIST, 2017.
WALL, PAVING. Kotthaus, Smith, Wooster, Grimmond, *Derivation of an urban materials spectral library
through emittance and reflectance spectroscopy*, ISPRS Journal of Photogrammetry and Remote Sensing,
2014; Ilehag, Schenk, Huang, Hinz, *KLUM: an urban VNIR and SWIR spectral library consisting of
building materials*, Remote Sensing, 2019.
ASPHALT. New roads are dark, old ones bright: Herold, Roberts, *Mapping asphalt road conditions with
hyperspectral remote sensing*, 2005.
GRASS. Meerdink, Hook, Roberts, Abbott, *The ECOSTRESS spectral library version 1.0*, Remote Sensing
of Environment, 2019.
MARKING. At 30 m classes R2 to R5 send back 100 to 300 mcd per lux and square metre (EN 1436, *Road
marking performance for road users*, 2018), 0.3 to 0.9 of what a white diffuser does that faces the
beam. It lies flat here, so the cosine is taken out for 10 m; less where it is worn."""


def reflectivity(
    materials: NDArray[np.integer], shares: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return quantiles of the reflectivity of materials at `shares`, in [0, 1]; same shape.

    Raises ValueError for a number that is no `Material`."""
    reflectivities = np.full(np.shape(materials), np.nan)
    for material, knots in REFLECTIVITY.items():
        of_material = materials == material
        reflectivities[of_material] = np.interp(shares[of_material], *np.transpose(knots))
    if np.isnan(reflectivities).any():
        raise ValueError(f"no material {materials[np.isnan(reflectivities)].flat[0]}")
    return reflectivities


def uniforms(key: str, number: int, purpose: bytes = b"") -> NDArray[np.float64]:
    """Return uniform numbers in [0, 1) of key and purpose; at most 8, shape (number,)."""
    digest = hashlib.blake2b(key.encode(), digest_size=8 * number, person=purpose).digest()
    return np.frombuffer(digest, "<u8") * 2.0**-64
