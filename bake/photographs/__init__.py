"""Stacks of photographs of a flat swatch lit from several directions, read into linear values for shading maps."""

from .photograph import MAX_PIXELS, Exposure, Photograph, PhotoInfo
from .settings import StackSettings
from .stack import PhotoStack, read_stack

__all__ = ["MAX_PIXELS", "Exposure", "PhotoInfo", "PhotoStack", "Photograph", "StackSettings", "read_stack"]
