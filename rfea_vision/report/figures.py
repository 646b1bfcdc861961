"""Every figure of the page by name: its title, how to read it, and what a screen reader says of it."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Figure:
    """``how`` tells how to read it; ``label`` is the text alternative; ``height`` in CSS pixels."""

    name: str
    title: str
    how: str
    label: str
    height: int = 240


_BAND = "measured and modelled, with the 95 % band that the errors of the parameters leave the model"

FIGURES = {
    figure.name: figure
    for figure in (
        Figure("pressure", "Pressure", "", "Pressure over time", 104),
        Figure("tip-x", "Tip x", "", f"Horizontal tip position over time, {_BAND}", 116),
        Figure("tip-y", "Tip y", "", f"Vertical tip position over time, {_BAND}", 116),
        Figure("angle", "Bend angle", "", f"Bend angle over time, {_BAND}", 116),
        Figure(
            "error",
            "Tip error",
            "Distance between measured and modelled tip, with the noise floor dashed; shaded are the worst stretches, in which the "
            "whole tube counts where it was fitted. Red marks "
            "frames set aside; the line breaks where the track jumps and the fit left it out. Drag to move in time, click near "
            "a peak to jump to it.",
            "Tip error over time; click a peak to jump to it",
            128,
        ),
        Figure(
            "carpet",
            "Error along the tube",
            "One column per instant, clamp at the top, tip at the bottom. The strip on top names the phase of "
            "the pressure. A complete model leaves grain without stripes or stains. Half a per cent of all values lie "
            "beyond the ends of the colours.",
            "Carpet of the distance between measured and modelled tube over time and along the tube",
            300,
        ),
        Figure(
            "phases",
            "By phase",
            "Root mean square error while the pressure rises, holds, falls and so on. The ring is the rung before.",
            "Tip error by phase of the pressure",
            220,
        ),
        Figure(
            "pressures",
            "By pressure",
            "Root mean square error in bands of pressure. The ring is the rung before.",
            "Tip error by pressure band",
            220,
        ),
        Figure(
            "segments",
            "By place along the tube",
            "Root mean square distance along the normal, from clamp (0) to tip (1). The ring is the rung before.",
            "Error by place along the tube",
            220,
        ),
        Figure(
            "torque",
            "Residual torque",
            "The torque per segment that would close the gap between model and measurement. Grey where it is "
            "smaller than its own standard error. Half a per cent of all values lie beyond the ends of the colours.",
            "Carpet of the residual torque over time and segment",
            260,
        ),
        Figure(
            "torque-cloud",
            "What the residual torque depends on",
            "One dot per instant for the chosen segment. A curve means a law that is missing; a round cloud "
            "means noise.",
            "Scatter of the residual torque against a chosen quantity",
            300,
        ),
        Figure(
            "loop-angle",
            "Angle against pressure",
            "An open loop is memory: friction, creep or plain inertia. Both loops should have the same width.",
            "Hysteresis loop of the bend angle against the pressure, measured and modelled",
            300,
        ),
        Figure(
            "loop-tip",
            "Height against pressure",
            "The same loop seen at the tip.",
            "Hysteresis loop of the tip height against the pressure, measured and modelled",
            300,
        ),
        Figure(
            "path",
            "Path of the tip",
            "Where the tip travels, clamp at (0, 0), at equal scale in x and y.",
            "Path of the tip in x and y, measured and modelled",
            300,
        ),
        Figure(
            "paths",
            "Path of the tip, training and held out",
            "All runs of each kind at one scale, clamp at (0, 0): measured in blue, modelled in orange. A model that fits on the "
            "left and fails on the right has learned the runs, not the tube.",
            "Path of the tip in x and y for the training runs and the held-out runs, measured and modelled",
            340,
        ),
        Figure(
            "next",
            "The experiment to run next",
            "Pressure to command over time.",
            "Pressure over time of the next experiment",
            200,
        ),
        Figure(
            "elongation",
            "Elongation of each segment",
            "One column per instant, clamp at the top. Brighter is longer.",
            "Heat map of the elongation over time and segment",
            420,
        ),
        Figure(
            "profile-now",
            "Profile at the time cursor",
            "Elongation from clamp (0) to tip (1) at this instant; the band is one standard error of the measurement.",
            "Elongation along the tube at the time cursor, measured with band and modelled",
            280,
        ),
        Figure(
            "profiles",
            "Profile at chosen pressures",
            "Dots with bands are measured, lines modelled, one colour per pressure.",
            "Elongation along the tube at chosen pressures",
            280,
        ),
        Figure(
            "tracking",
            "Standard error of the tip",
            "",
            "Standard error of the tracked tip over time, with the frames set aside",
            110,
        ),
        Figure("seen", "Share of the edges seen", "", "Share of the tube's edges found in each frame", 104),
        Figure(
            "blur",
            "Blur of the edges",
            "All three should be flat; a step or a spike marks frames to look at. Red: frames set aside, their reasons below.",
            "Blur of the tube's edges in each frame",
            140,
        ),
        Figure(
            "hinge",
            "Length of the inner side",
            "One dot per instant against the bend angle. The inner side cannot stretch: a slope means that the plane, the "
            "lens or the scale is off.",
            "Length of the tube's inextensible side against its bend angle",
            280,
        ),
        Figure(
            "sync",
            "Pressure and motion on one clock",
            "Both are stretched to the full height. Motion must start with the pressure, not before it.",
            "Pressure and bend angle over time on one clock",
            190,
        ),
        Figure(
            "width",
            "Width of the tube",
            "The paper assumes a constant outer radius: the width should not depend on time or place.",
            "Heat map of the tracked width over time and along the tube",
            220,
        ),
        Figure(
            "offsets",
            "Offsets tried",
            "How much of the motion follows the pressure, over the offset tried. A single sharp peak at the line is a sure "
            "alignment; a second one as high is a doubt.",
            "Share of the motion explained over the offset of the clocks",
            190,
        ),
        Figure(
            "photos",
            "Corners of the board that do not fit",
            "Worst photo first. Each stroke is the distance from where a corner was seen to where the lens model "
            "puts it, much enlarged and to one scale. Strokes that all point one way tell of a lens or board that is not as "
            "assumed.",
            "Reprojection residuals of the calibration photos, worst first",
            420,
        ),
        Figure(
            "uncertainty",
            "Uncertainty",
            "Standard error of a point in the plane of motion, relative to the middle of the picture. Brightest: ten times "
            "the median, or more.",
            "Map of the calibration's standard error in mm over the picture",
            300,
        ),
        Figure(
            "coverage",
            "Places of the board",
            "Corners seen in each field of the picture, all photos together. Outlined: none; the lens is a guess there.",
            "Number of corners seen in each field of the picture",
            300,
        ),
        Figure(
            "study",
            "Error",
            "Ring: training; dot: held out; thick: tip, thin: its x and y. Where the curve is flat, more segments buy nothing.",
            "Tip error against the number of segments, training and held out, in x and in y",
            280,
        ),
        Figure(
            "study-path",
            "Path of the tip",
            "Measured in blue, beneath; modelled with each number of segments, the finest as a full line.",
            "Path of the tip for each number of segments beside the measured one",
            280,
        ),
        Figure(
            "study-seconds",
            "Price",
            "Seconds that the fit of each chain took on the machine that made it, both axes logarithmic.",
            "Seconds of the fit against the number of segments",
            280,
        ),
        Figure(
            "likelihood",
            "Profile likelihood",
            "Rise of the misfit as one parameter is held off its best value and all others follow. Below the dashed line lies "
            "the 95 % interval; a side that never reaches it is not bounded by these data.",
            "Profile likelihood of parameters",
            220,
        ),
        Figure(
            "correlation",
            "Correlations",
            "Near +1 or -1 two parameters cannot be told apart: read them together. The table of parameters says what each is.",
            "Matrix of parameter correlations",
            280,
        ),
        Figure(
            "steady",
            "Steady state",
            "Bend angle once the tube has come to rest, measured and fitted. The dynamic fit starts here.",
            "Bend angle at rest against pressure, measured and fitted",
            280,
        ),
        Figure(
            "starts",
            "Starts of the fit",
            "Final cost of every start, best first. A flat beginning means that many starts find the same answer.",
            "Final cost of each start of the fit",
            240,
        ),
    )
}


OF_BEAM = Figure(
    "hinge",
    "Length of the middle",
    "One dot per instant against the bend angle. A beam bends about its middle: a slope means that it stretches, or that the "
    "plane, the lens or the scale is off.",
    "Length of the beam's middle against its bend angle",
    280,
)


def figures_in(unit: str, *, beam: bool = False) -> dict[str, Figure]:
    """The figures of a page whose errors are in ``mm`` at the tip, or in ``deg`` where only an angle was measured."""
    figures = FIGURES | ({"hinge": OF_BEAM} if beam else {})
    if unit == "mm":
        return figures
    error = FIGURES["error"]
    how = error.how.replace(
        "Distance between measured and modelled tip", "Measured minus modelled bend angle, without sign"
    )
    return figures | {
        "error": replace(error, title="Angle error", how=how, label=error.label.replace("Tip", "Angle")),
        "study": replace(
            FIGURES["study"],
            how="Ring: training; dot: held out. Where the curve is flat, more segments buy nothing.",
            label="Angle error against the number of segments, training and held out",
        ),
        "phases": replace(FIGURES["phases"], label="Angle error by phase of the pressure"),
        "pressures": replace(FIGURES["pressures"], label="Angle error by pressure band"),
    }
