"""Pictures of what tracking finds."""

from .drawings import drawings

__all__ = ["drawings"]
