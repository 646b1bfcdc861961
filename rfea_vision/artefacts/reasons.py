"""Why a frame has no curve: the reasons that a track may give, what to do about each, and where on the workbench."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Reason:
    """One reason of rejection.

    Attributes
    ----------
    words : what people read
    remedy : what to do where many frames have it
    tool, button : the tool of the workbench that may mend it, and what its button says
    """

    words: str
    remedy: str = "'rfea track --preview' shows what was seen"
    tool: str = ""
    button: str = ""


REASONS: dict[str, Reason] = {
    "no_tube": Reason(
        "no tube was found",
        "check actuator.outer_radius (half of what a caliper shows) and the board's square or camera.scale, or give camera.clamp and "
        "camera.tip in pixels",
        "clamp",
        "Point at the clamp",
    ),
    "occluded": Reason(
        "something stood in front of the tube",
        "keep the view free, or give camera.clamp and camera.tip in pixels",
        "exclude",
        "Leave out what hides it",
    ),
    "edge_lost": Reason("an edge of the tube was not to be seen", tool="exclude", button="Leave out what hides it"),
    "off_hints": Reason("what was found was not where the hints point", tool="clamp", button="Point again"),
    "blurred": Reason("the picture is blurred", "use a shorter exposure, more light, or a sharper focus"),
    "width_off": Reason(
        "the width is not that of the tube",
        "check actuator.outer_radius (half of what a caliper shows) and the board's square or camera.scale",
        "clamp",
        "Point at both edges",
    ),
    "length_off": Reason(
        "the length is not that of the tube",
        "check actuator.length and the board's square or camera.scale",
        "tip",
        "Point at the tip",
    ),
    "touches_border": Reason("the tube leaves the picture", "keep all of the tube in the picture"),
    "tip_hidden": Reason("the tip was hidden", "keep the free end in view", "tip", "Point at the tip"),
    "no_fit": Reason(
        "the curve did not settle",
        "look at the preview; a calmer background helps",
        "region",
        "Say where the tube is",
    ),
    "low_confidence": Reason(
        "the tracker did not trust a point of the tube",
        "lower track.confidence if they look right, or train the tracker on such frames",
    ),
    "not_tracked": Reason("the row has no numbers", "the rows without numbers in the track's file are left out"),
}


def reason_of(code: str) -> Reason:
    """The reason behind a code, with or without details after a colon; an unknown one stands for itself."""
    return REASONS.get(code.partition(":")[0], Reason(code))
