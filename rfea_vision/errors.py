"""What goes wrong, said in one sentence that names the file, the key and the remedy."""

from __future__ import annotations


class RfeaError(Exception):
    """Base of every error meant for the user; `exit_code` is what the command line returns."""

    exit_code = 1


class InputError(RfeaError):
    """A broken input file or wrong usage (exit code 2)."""

    exit_code = 2


class DataError(RfeaError):
    """The input is readable, but the data do not allow what was asked (exit code 1)."""

    exit_code = 1
