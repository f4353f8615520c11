"""AMI, the Algorithm of Mode Isolation: one mode after another out of the composite spectrum."""

from floquid.lti.ami._ami import AMI

__all__ = ["AMI"]
