"""A finished capture as files of other programs."""

from perfcap.io.export.formats import FORMATS, Format
from perfcap.io.export.options import UNITS, Options
from perfcap.io.export.recording import Recording
from perfcap.io.publish import publishing

__all__ = ["FORMATS", "UNITS", "Format", "Options", "Recording", "publishing"]
