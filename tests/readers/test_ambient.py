"""Absolute pressures beside the air's own, as a second column of the same log."""

import numpy as np
import pandas as pd
import pytest

from rfea_vision.campaign.schema import PressurePart
from rfea_vision.campaign.specs import PressureSpec
from rfea_vision.errors import InputError
from rfea_vision.readers.pressure import read_pressure

TIME_S = np.arange(0.0, 2.0, 0.01)
GAUGE_KPA = 40.0 * np.sin(2 * np.pi * TIME_S) ** 2
AIR_KPA = 97.0 + 0.5 * TIME_S


def _log(folder, **columns):
    pd.DataFrame({"time_s": TIME_S, **columns}).to_csv(folder / "log.csv", index=False)
    return folder / "log.csv"


@pytest.mark.parametrize(
    ("name", "air"), [("p_atm", AIR_KPA), ("air_kPa", AIR_KPA), ("air_hPa", 10 * AIR_KPA), ("air [mbar]", 10 * AIR_KPA)]
)
def test_the_air_is_taken_off_in_its_own_unit(tmp_path, name, air):
    file = _log(tmp_path, p_bar=(GAUGE_KPA + AIR_KPA) / 100, **{name: air})
    spec = PressureSpec(file, PressurePart(reference="absolute", pressure="p_bar", ambient=name))
    np.testing.assert_allclose(read_pressure(spec).pressure_kPa, GAUGE_KPA, atol=1e-9)


def test_a_column_of_the_air_that_there_is_not_is_named(tmp_path):
    spec = PressureSpec(_log(tmp_path, pressure_kPa=GAUGE_KPA + AIR_KPA), PressurePart(reference="absolute", ambient="air"))
    with pytest.raises(InputError, match="air"):
        read_pressure(spec)
