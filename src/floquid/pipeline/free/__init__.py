"""Identification of free responses, lifted and as they were sampled."""

from floquid.pipeline.free._complete import again_of, by_cycles, lifted_views, samples_of, validated, why_sampled
from floquid.pipeline.free._find_poles import find_poles
from floquid.pipeline.free._identify import identified_free
from floquid.pipeline.free._start import lifted

__all__ = ["find_poles", "identified_free", "lifted", "lifted_views", "samples_of", "validated"]
