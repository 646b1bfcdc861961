"""Non-uniform elongation: is the tube stretched alike all along, and does the model stretch it so?"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from rfea_vision.artefacts.measurement import CHOOSING_ROLES, Recording
from rfea_vision.artefacts.rows import Elongation, ElongationProfile

ASSUMPTION = (
    "Read from the curvature at the tube's half width, with the inner side taken as inextensible: at constant width this is "
    "(w/2) times the curvature, not an independent measurement of the stretch."
)

#: A standard error by which a segment may as well be folded as twice as long: nothing is said of it.
NOT_TOLD = 0.5


def describe_elongation(recordings: Mapping[str, Recording], predictions: Mapping[str, xr.Dataset]) -> Elongation:
    """Profiles at up to three pressures, measured and modelled, and the test of uniformity in a sentence.

    Uniformity is tested by chi-square over the segments' means against their standard errors, frames of one profile taken
    as fully correlated (the errors of neighbouring frames are alike), so that the test does not grow with the frame rate.
    """
    chosen = [
        (name, r)
        for name, r in recordings.items()
        if r.role in CHOOSING_ROLES and "elongation" in r.dataset and name in predictions
    ]
    if not chosen:
        lines = any("midline" in r.dataset for r in recordings.values())
        why = "these nodes were placed evenly by another tool" if lines else "these recordings have no centre line"
        absent = (str(r.dataset.attrs.get("elongation_assumption", "")) for r in recordings.values())
        why = next((said.removeprefix("absent: ") for said in absent if said.startswith("absent: ")), why)
        return {
            "sentence": f"The elongation along the tube was not measured: {why}.",
            "assumption": "",
            "profiles": [],
        }
    name, recording = max(chosen, key=lambda pair: float(np.nanmax(np.abs(pair[1].dataset["pressure"].values))))
    data, model = recording.dataset, predictions[name]
    time = data["time"].values
    pressure = np.interp(time, data["log_time"].values, data["pressure"].values)
    seen = pressure[data["valid"].values.astype(bool)]
    # below zero where a chamber bends to the other side
    top = float(seen[np.argmax(np.abs(seen))]) if seen.size else 0.0
    profiles: list[ElongationProfile] = []
    sentence = "The pressure never rose enough to test the elongation."
    for share in (0.33, 0.66, 0.95):
        inside = (np.abs(pressure - share * top) < 0.03 * abs(top)) & data["valid"].values.astype(bool)
        if inside.sum() < 5:
            continue
        measured = data["elongation"].values[inside]
        mean = np.nanmean(measured, axis=0)
        if "elongation_sigma" in data:
            sigma = np.nanmedian(data["elongation_sigma"].values[inside], axis=0)
        else:
            sigma = np.nanstd(measured, axis=0)
        segments = mean.size
        own = np.nanmean(model["elongation"].values[inside], axis=0)
        centre = (np.arange(segments) + 0.5) / segments
        modelled = np.interp(centre, (np.arange(own.size) + 0.5) / own.size, own)
        weight = 1 / np.maximum(sigma, 1e-6) ** 2
        uniform = float(np.sum(weight * mean) / np.sum(weight))
        chi2 = float(np.sum(weight * (mean - uniform) ** 2))
        profiles.append(
            {
                "pressure_kPa": share * top,
                "experiment": name,
                "position": centre.tolist(),
                "measured": mean.tolist(),
                "sigma": sigma.tolist(),
                "modelled": modelled.tolist(),
                "chi2": chi2,
                "degrees_of_freedom": segments - 1,
            }
        )
        told = sigma < NOT_TOLD
        spread = float(np.ptp(mean[told])) if told.any() else 0.0
        uneven = chi2 > (segments - 1) + 3 * np.sqrt(2 * (segments - 1))
        verdict = "is not uniform" if uneven else "is uniform within its errors"
        sentence = f"The elongation of {name} is not known anywhere along the tube at {share * top:.0f} kPa."
        if told.any():
            known = "" if told.all() else f"the {told.sum()} that are known of "
            sentence = (
                f"At {share * top:.0f} kPa the elongation {verdict}: {100 * mean[told].min():.1f} to {100 * mean[told].max():.1f} % "
                f"(mean {100 * uniform:.1f} %, spread {100 * spread:.1f} points) over {known}{segments} segments of {name}."
            )
    return {"sentence": sentence, "assumption": ASSUMPTION, "profiles": profiles}
