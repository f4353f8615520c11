"""Channels that tell the angle of the shaft, by their names and units."""

from __future__ import annotations

import re

CLOCK_NAME = re.compile(
    r"(?<![a-z])(tacho?s?|tachometer|pulses?|key ?phas\w*|encoder|azimuth|trigger|revs?|revolutions?"
    r"|(?:shaft|rotor|crank|phase) ?(?:angle|position|phase)|theta|psi|rpm)(?![a-z])",
    re.IGNORECASE,
)
"""A word in the name of a channel that may be a clock."""

TURNS = {"deg": 360.0, "rad": 6.283185307179586}
"""A revolution in the units of an angle."""

_ANGLE_NAME = re.compile(
    r"(?<![a-z])(?:azimuth|encoder|(?:shaft|rotor|crank) ?(?:angle|position|phase)|LSSTip(?:P|Pxa|Pxs)"
    r"|LSSGag(?:P|Pxa|Pxs))(?![a-z])",
    re.IGNORECASE,
)


def is_shaft_angle(name: str, unit: str) -> bool:
    """True where a channel is an angle of the shaft: by its name (also OpenFAST's other names of it) and its unit."""
    return unit in TURNS and _ANGLE_NAME.search(name.replace("_", " ")) is not None
