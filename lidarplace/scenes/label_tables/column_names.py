"""Which column of a label file is what, by its name, and which class a category is."""

import re
import unicodedata
from collections.abc import Sequence
from difflib import SequenceMatcher

import numpy as np
from scipy.optimize import linear_sum_assignment

USUAL = {
    "drive": "drive recording recording_id sequence session log run trip scene route clip segment",
    "time": "time timestamp stamp t time_stamp timestamp_s timestamp_us timestamp_ns utc epoch",
    "frame": "frame frame_id frame_index frame_number sample image_id",
    "object": "object_id track_id track object id instance_id instance uuid target_id",
    "category": "class category label type kind cls",
    "x": "x pos_x position_x center_x centre_x cx loc_x location_x tx translation_x",
    "y": "y pos_y position_y center_y centre_y cy loc_y location_y ty translation_y",
    "z": "z pos_z position_z center_z centre_z cz loc_z location_z tz translation_z",
    "length": "length l len size_x size_l dim_l dim_x extent_x dx",
    "width": "width w wid size_y size_w dim_w dim_y extent_y dy",
    "height": "height h hgt size_z size_h dim_h dim_z extent_z dz",
    "yaw": "yaw heading rotation_z rot_z orientation theta psi yaw_angle angle direction",
    "points": "points num_points num_lidar_pts num_interior_pts point_count lidar_points n_points",
    "poses.x": "ego_x ego_pos_x ego_position_x vehicle_x host_x ego_east",
    "poses.y": "ego_y ego_pos_y ego_position_y vehicle_y host_y ego_north",
    "poses.z": "ego_z ego_pos_z ego_position_z vehicle_z host_z ego_up",
    "poses.yaw": "ego_yaw ego_heading vehicle_yaw vehicle_heading host_yaw host_heading",
}
"""Key of the mapping -> names that it has in label files."""

UNITS = ("mm", "cm", "m", "rad", "deg", "degrees", "s", "ms", "us", "ns")
ALIKE = 0.8
"""Names less alike than this share of their letters are not taken for each other."""


STEMS = {
    "length": "laeng|lange|longueur",
    "width": "breit|largeur",
    "height": "hoeh|hohe|hauteur",
    "yaw": "gier|drehwinkel|kurs|lacet|^cap$",
    "class": "klass|kategor|classe|categor",
    "time": "zeit|temps|horodat",
    "drive": "fahrt|aufnahm|sequenz|trajet|enregistr",
    "frame": "bild|trame",
    "object": "objekt|objet|spur|piste",
    "vehicle": "fahrzeug|eigen|vehicule",
    "center": "mitte",
}
"""English word -> German and French stems of it, as a regular expression."""
_STEM = re.compile("|".join(f"(?P<{word}>{stems})" for word, stems in STEMS.items()))

CLASS_NAMES = {
    "Pedestrian": r"pedestrian|person(?!al)|human|walker|fu(ss|ß)g|pi[eé]ton",
    "Cyclist": r"cycl|bike(?!.?rack)|rider|fahrrad|radfahr|v[eé]lo(?!c)",
    "Car": r"car(?![a-z])|sedan|suv|taxi|pkw|voiture",
}
"""What in the name of a category tells the class; the guess leaves out all others."""


def class_in(category: str) -> str | None:
    """The class that the name of a category tells."""
    found = (c for c, told in CLASS_NAMES.items() if re.search(told, category, re.IGNORECASE))
    return next(found, None)


def plain(name: str) -> str:
    """A name in lower case with underscores: `posX [mm]` is `pos_x_mm`, `Höhe` is `hohe`."""
    bare = "".join(c for c in unicodedata.normalize("NFKD", name) if not unicodedata.combining(c))
    apart = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", bare)
    return re.sub(r"[^a-z0-9]+", "_", apart.lower()).strip("_")


def _in_english(name: str) -> str:
    """A plain name with the words for which there are stems: `objektklasse` is `object_class`."""
    words = [[str(m.lastgroup) for m in _STEM.finditer(word)] or [word] for word in name.split("_")]
    return "_".join(part for parts in words for part in parts)


def unit_in(name: str) -> str | None:
    """The unit at the end of a name, `mm` of `length_mm`."""
    last = plain(name).rpartition("_")[2]
    return ("deg" if last == "degrees" else last) if last in UNITS and last != plain(name) else None


def without_unit(name: str) -> str:
    """The plain name without its unit."""
    return plain(name).removesuffix(f"_{plain(name).rpartition('_')[2]}" if unit_in(name) else "")


def guess_columns(columns: Sequence[str]) -> dict[str, str]:
    """A column for each key of `USUAL` that has one, so that names are most alike altogether."""
    likeness = np.array([[_likeness(name, usual) for name in columns] for usual in USUAL.values()])
    likeness = np.where(likeness < ALIKE, 0.0, likeness)
    keys = list(USUAL)
    pairs = zip(*linear_sum_assignment(-likeness), strict=True)
    return {keys[i]: columns[j] for i, j in pairs if likeness[i, j] > 0}


def _likeness(name: str, usual: str) -> float:
    """1 for a usual name, a little less for a later one."""
    own = {plain(name), without_unit(name), _in_english(without_unit(name))}
    own |= {re.sub("^(object|obj|box)_|_(object|obj|box)$", "", mine) for mine in own}
    return max(
        SequenceMatcher(None, mine, other).ratio() - 0.001 * place
        for mine in own
        for place, other in enumerate(usual.split())
    )
