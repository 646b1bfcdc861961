"""What is done to the bytes of a file that is right, and to the numbers of a table before it is written."""

from __future__ import annotations

import random
import struct

import numpy as np
import pandas as pd

_NUMBERS = [
    b"nan",
    b"inf",
    b"-inf",
    b"1e400",
    b"-1",
    b"0",
    b"1e-320",
    b"9" * 400,
    b"0x10",
    b"1,5",
    b"",
    b"\xff",
    b"1_0",
    b"--1",
    b"1e9",
]
_TEXTS = [b"\0", b"\xff\xfe", b"\xef\xbb\xbf", b"\r", b"\n\n\n", b'"', b"'", b";", b"\t", b"#", b"%YAML:1.0\n", b"{" * 200, b"[" * 200,
          b"&a [*a]", b"!!python/object/apply:os.system ['true']", b"<<: *x", b"9" * 5000, b"\x1b[2J",
          b"${HOME}", b"../" * 40]  # fmt: skip
_WORDS = [
    struct.pack(kind, number)
    for kind in ("<I", ">I", "<Q", ">Q", "<i", "<d")
    for number in (0, 1, 255, 65535, 10**9, 2**31 - 1)
]


def mutated(content: bytes, chance: random.Random) -> bytes:
    """One to four changes of a file's bytes."""
    data = bytearray(content)
    for _ in range(chance.choice((1, 1, 1, 2, 4))):
        data = chance.choice(_BINARY)(data, chance)
    return bytes(data[:4_000_000])


def _cut(data: bytearray, chance: random.Random) -> bytearray:
    return data[: chance.randrange(len(data) + 1)]


def _flip(data: bytearray, chance: random.Random) -> bytearray:
    for _ in range(chance.choice((1, 2, 8, 64))):
        if data:
            data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    return data


def _word(data: bytearray, chance: random.Random) -> bytearray:
    at, word = chance.randrange(len(data) + 1), chance.choice(_WORDS)
    data[at : at + len(word)] = word
    return data


def _remove(data: bytearray, chance: random.Random) -> bytearray:
    at = chance.randrange(len(data) + 1)
    del data[at : at + chance.choice((1, 4, 64, 4096))]
    return data


def _repeat(data: bytearray, chance: random.Random) -> bytearray:
    at = chance.randrange(len(data) + 1)
    return data[:at] + data[at : at + 256] * chance.choice((2, 16, 256)) + data[at:]


def _insert(data: bytearray, chance: random.Random) -> bytearray:
    at = chance.randrange(len(data) + 1)
    return data[:at] + chance.choice(_TEXTS) + data[at:]


def _number(data: bytearray, chance: random.Random) -> bytearray:
    """Put something else in place of a run of digits."""
    at = next((i for i in range(chance.randrange(len(data) + 1), len(data)) if chr(data[i]).isdigit()), None)
    if at is None:
        return data
    end = at
    while end < len(data) and (chr(data[end]).isdigit() or data[end] in b".eE+-"):
        end += 1
    return data[:at] + chance.choice(_NUMBERS) + data[end:]


def _swap_lines(data: bytearray, chance: random.Random) -> bytearray:
    lines = data.split(b"\n")
    first, second = chance.randrange(len(lines)), chance.randrange(len(lines))
    lines[first], lines[second] = lines[second], lines[first]
    return bytearray(b"\n".join(lines))


def _drop_cell(data: bytearray, chance: random.Random) -> bytearray:
    lines = data.split(b"\n")
    at = chance.randrange(len(lines))
    cells = lines[at].split(b",")
    cells.pop(chance.randrange(len(cells)))
    lines[at] = b",".join(cells)
    return bytearray(b"\n".join(lines))


def _noise(data: bytearray, chance: random.Random) -> bytearray:
    return bytearray(chance.randbytes(chance.choice((0, 1, 8, 512, 20_000))))


_BINARY = [
    _cut,
    _flip,
    _flip,
    _word,
    _word,
    _remove,
    _repeat,
    _insert,
    _number,
    _number,
    _number,
    _swap_lines,
    _drop_cell,
    _noise,
]


# -- tables that are written as they should be, and hold what they should not -----------------------------------------

_CELLS = (np.nan, np.inf, -np.inf, -1.0, 0.0, 1e300, -1e300, 1e-320, 2.0**63, 1e9)


def spoilt(table: pd.DataFrame, chance: random.Random) -> pd.DataFrame:
    """One to three changes of a table's values, rows or columns."""
    for _ in range(chance.choice((1, 1, 2, 3))):
        table = chance.choice(_SPOILS)(table.copy(), chance)
    return table


def _a_row(table: pd.DataFrame, chance: random.Random) -> int:
    return chance.randrange(len(table)) if len(table) else 0


def _a_cell(table: pd.DataFrame, chance: random.Random) -> pd.DataFrame:
    if table.size:
        table.iloc[_a_row(table, chance), chance.randrange(table.shape[1])] = chance.choice(_CELLS)
    return table


def _a_repeated_row(table: pd.DataFrame, chance: random.Random) -> pd.DataFrame:
    at = _a_row(table, chance)
    return pd.concat([table.iloc[:at], table.iloc[at : at + 1], table.iloc[at:]], ignore_index=True)


def _two_columns_swapped(table: pd.DataFrame, chance: random.Random) -> pd.DataFrame:
    names = list(table.columns)
    chance.shuffle(names)
    table.columns = names
    return table


def _no_column(table: pd.DataFrame, chance: random.Random) -> pd.DataFrame:
    return table.drop(columns=chance.choice(list(table.columns))) if table.shape[1] > 1 else table


_SPOILS = [
    _a_cell,
    _a_cell,
    _a_repeated_row,
    _two_columns_swapped,
    _no_column,
    lambda table, chance: table.iloc[::-1].reset_index(drop=True),
    lambda table, chance: table.sample(frac=1.0, random_state=chance.randrange(1000)).reset_index(drop=True),
    lambda table, chance: table.iloc[: chance.choice((0, 1, 2, 3))],
    lambda table, chance: table * chance.choice((-1.0, 0.0, 1e30, 1e-30)),
    lambda table, chance: table.assign(**{chance.choice(list(table.columns)): np.nan}),
]
