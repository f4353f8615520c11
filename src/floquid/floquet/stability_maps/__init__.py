"""Stability over one or two parameters: many systems A(t; p) at once."""

from floquid.floquet.stability_maps._stability_map import Instability, StabilityMap, stability_map
