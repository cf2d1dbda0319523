"""What a rig keeps of what its file says, which another rig in its place is to keep, too."""

from lidarplace.studio.rig import Rig
from lidarplace.studio.rigs_file import RigsFile
from lidarplace.studio.violations import judged, violations


class Limits:
    """Constraints and requirements that hold under a rig.

    Args:
        rig: as it is, or was.
        file: says what is asked.
    """

    def __init__(self, rig: Rig, file: RigsFile) -> None:
        self._file = file
        self._broken = {(one.constraint, one.lidars) for one in violations(rig, file)}
        met = {one.requirement.name for one in judged(rig, file, file.laid) if one.met}
        self._met = [own for own in file.laid if own.requirement.name in met]

    def broken_by(self, rig: Rig) -> tuple[str, ...]:
        """Names of what held and does not under another rig, whose LiDARs have the same numbers.

        Requirements take longest: they are judged if all else is kept.
        """
        now = violations(rig, self._file)
        broken = [one.constraint for one in now if (one.constraint, one.lidars) not in self._broken]
        if broken or not self._met:
            return tuple(dict.fromkeys(broken))
        met = {one.requirement.name for one in judged(rig, self._file, self._met) if one.met}
        names = (own.requirement.name for own in self._met)
        return tuple(name for name in names if name not in met)
