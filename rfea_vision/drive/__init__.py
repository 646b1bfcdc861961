"""The digital hydraulic drive of the paper's section II-B: valve commands in, pressure out."""

from rfea_vision.drive.commands import DutyControl, ValveCommands, read_commands
from rfea_vision.drive.constants import DriveConstants
from rfea_vision.drive.hydraulics import Drive, Hydraulics, orifice_flow

__all__ = ["Drive", "DriveConstants", "DutyControl", "Hydraulics", "ValveCommands", "orifice_flow", "read_commands"]
