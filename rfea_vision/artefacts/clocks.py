"""The ways to bring camera clock and log clock together: their names in `sync.method`, and how the report says them."""

from __future__ import annotations

SYNC_METHODS = {
    "motion": "matching the motion to the pressure",
    "led": "a lamp that both saw",
    "trigger": "a trigger that the log recorded",
    "offset": "an offset known beforehand",
    "common_clock": "recording them on the same clock",
}
