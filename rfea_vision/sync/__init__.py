"""Track and pressure log on one clock: offset and drift, with standard errors."""

from rfea_vision.sync.synchronise import synchronise

__all__ = ["synchronise"]
