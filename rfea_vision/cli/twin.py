"""Commands around the twin: simulate, demo."""

from __future__ import annotations
