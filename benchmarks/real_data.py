"""Real data made by others: a pressure-against-tip table and a torque-driven two-link chain."""

from __future__ import annotations

from typing import Any

import numpy as np

from testing.chain_diagnosis import diagnose_chain
from testing.pressure_tip import fit_table
from testing.real_records import SHARED, pressure_tables, published_friction, two_links

#: From the best bender to one that hardly bends but grows.
CONFIGURATIONS = ("DS10-DS10-0-1", "EF30-DS30-6-6", "DS30-DS30-0-1", "DS30-EF30-6-1", "DS30-DS10-3-3", "DS10-DS10-3-2")


def run() -> list[dict[str, Any]]:
    """Rows of results; none where the data is not beside the checkout."""
    if not SHARED.is_dir():
        return []
    rows: list[dict[str, Any]] = []
    tables = pressure_tables()
    for name in CONFIGURATIONS:
        if name not in tables:
            continue
        radius, fit = fit_table(tables[name])
        rows.append(
            {
                "name": f"static tip {name}: rms of the fitted steady state (radius {radius * 1e3:.0f} mm)",
                "value": round(fit.rms_mm, 2),
                "unit": "mm",
                "against": f"{fit.straight_rms_mm:.1f} mm if it did not move",
            }
        )
    links = two_links()
    for run_name, motion in links.motions.items():
        before = float(np.sqrt(np.mean(motion.residual[:, 1] ** 2)))
        after = float(np.sqrt(np.mean((motion.residual[:, 1] - published_friction(links, run_name, 2)) ** 2)))
        target = (0.174, 0.082) if run_name == "00" else None
        rows.append(
            {
                "name": f"two-link run {run_name}: residual torque of joint 2, bare and with the published friction",
                "value": f"{before:.3f} -> {after:.3f}",
                "unit": "N m",
                "target": None if target is None else f"{target[0]} -> {target[1]}",
                "met": None if target is None else bool(abs(before - 0.174) < 0.005 and abs(after - 0.082) < 0.005),
            }
        )
    found = diagnose_chain(links.chain, list(links.motions.values()), gravity=links.published["g"])
    first = found.named[0]
    cf2 = first.amplitude * 2 / np.pi  # the published law saturates at cf pi / 2
    rows += [
        {
            "name": "two-link chain, both runs: effect named first",
            "value": f"{first.effect} at joint {first.joint}",
            "unit": "",
            "target": "coulomb at joint 2",
            "met": bool(first.effect == "coulomb" and first.joint == 2),
        },
        {
            "name": "two-link chain, both runs: cf2",
            "value": round(cf2, 4),
            "unit": "N m",
            "target": "0.078 within 30 %",
            "met": bool(first.joint == 2 and abs(cf2 / 0.078 - 1) < 0.3),
        },
        {
            "name": f"two-link chain, joint 1 with all that was named ({', '.join(c.effect for c in found.named)})",
            "value": f"{found.rms_before[0]:.3f} -> {found.rms_after[0]:.3f}",
            "unit": "N m",
            "against": "an open problem of that data: friction does not close it",
        },
    ]
    return rows
