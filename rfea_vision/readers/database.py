"""Pressure logs from a database: a SQLite file, read and never written; any server that has a URL, through SQLAlchemy."""

from __future__ import annotations

import os
import sqlite3
import time
from pathlib import Path

import pandas as pd

from rfea_vision.errors import InputError
from rfea_vision.readers.kinds.base import MOST_VALUES, Table, frame_table

# A query that has not ended by then counts to infinity, or makes the database do work that belongs into it. Of processor time,
# as other programs' work is no fault of the file's; more for a large file, which has to be read through.
LONGEST_QUERY_S = 20.0
_MORE_S_PER_MB = 1.0
_LONGEST_VALUE = 1_000_000  # bytes of one value: columns of times and pressures hold numbers
_READING = {sqlite3.SQLITE_SELECT, sqlite3.SQLITE_READ, sqlite3.SQLITE_FUNCTION, sqlite3.SQLITE_RECURSIVE}
_BLOCK = 100_000


def read_query(url: str, query: str, folder: Path = Path()) -> Table:
    """Run a query and return its rows as columns; nothing can be changed by it.

    Parameters
    ----------
    url : SQLAlchemy URL; ``${NAME}`` is taken from the environment, so that no password stands in a file
    query : SQL that selects the columns
    folder : where a relative SQLite path starts

    Raises
    ------
    InputError
        If the URL or the query is wrong, the database cannot be reached, or nothing is found.
    """
    import sqlalchemy
    from sqlalchemy import exc

    try:
        parsed = sqlalchemy.make_url(os.path.expandvars(url))
    except exc.ArgumentError as error:
        raise InputError(
            f"pressure.url: '{url}' is not a database URL; write for example 'sqlite:///log.db'"
        ) from error
    shown = parsed.render_as_string(hide_password=True)
    if parsed.get_backend_name() == "sqlite":
        frame = _from_sqlite(shown, folder, parsed.database or "", query)
    else:
        frame = _from_server(shown, parsed, query)
    if frame.empty:
        raise InputError(f"pressure.query: {shown} returns no rows; correct the query")
    return frame_table(shown, frame)


def _from_sqlite(shown: str, folder: Path, name: str, query: str) -> pd.DataFrame:
    """Query a file that is opened for reading only, where no statement but SELECT is allowed."""
    path = (folder / name).resolve()
    if not path.is_file():  # SQLite would make an empty database in its place
        raise InputError(f"pressure.url: no database '{name}' in {folder}; correct the path")
    longest_s = LONGEST_QUERY_S + _MORE_S_PER_MB * path.stat().st_size / 1e6
    ends = time.thread_time() + longest_s
    try:
        connection = sqlite3.connect(f"{path.as_uri()}?mode=ro", uri=True)
        try:
            connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _LONGEST_VALUE)
            connection.execute("PRAGMA trusted_schema = OFF")
            connection.set_progress_handler(lambda: time.thread_time() > ends, 10_000)
            connection.set_authorizer(
                lambda action, *_: sqlite3.SQLITE_OK if action in _READING else sqlite3.SQLITE_DENY
            )
            answer = connection.execute(query)
            names = [column[0] for column in answer.description or ()]
            rows: list[tuple[object, ...]] = []
            while block := answer.fetchmany(_BLOCK):
                rows += block
                if len(rows) * len(names) > MOST_VALUES:
                    raise InputError(
                        f"pressure.query: {shown} returns more than {MOST_VALUES:.0e} values; select fewer"
                    )
        finally:
            connection.close()
    except (sqlite3.Error, sqlite3.Warning, ValueError, OverflowError, MemoryError) as error:
        if str(error) == "interrupted":
            fault = f"pressure.query: {shown} does not end within {longest_s:.3g} s of processor time on this machine"
            raise InputError(f"{fault}; correct the query, or select less") from error
        raise _refused(shown, error) from error
    return pd.DataFrame(rows, columns=names)


def _from_server(shown: str, parsed: object, query: str) -> pd.DataFrame:
    """Query a server in a transaction that may only read, and that is never committed."""
    import sqlalchemy
    from sqlalchemy import exc

    try:
        engine = sqlalchemy.create_engine(parsed)  # type: ignore[arg-type]
    except ImportError as error:
        raise InputError(f"pressure.url: {shown} needs the Python module '{error.name}'; install it") from error
    except exc.SQLAlchemyError as error:
        raise InputError(f"pressure.url: {shown}: {_reason(error)}; correct the URL") from error
    try:
        with engine.connect() as connection:
            if engine.dialect.name in ("postgresql", "mysql", "mariadb"):
                connection.exec_driver_sql("SET TRANSACTION READ ONLY")
            answer = connection.execute(sqlalchemy.text(query))
            return pd.DataFrame(answer.fetchmany(MOST_VALUES), columns=list(answer.keys()))
    except exc.SQLAlchemyError as error:
        raise _refused(shown, error) from error
    finally:
        engine.dispose()


def _refused(shown: str, error: Exception) -> InputError:
    fault = f"pressure.query: {shown} refuses it ({_reason(error)})"
    return InputError(f"{fault}; correct the query, which may only select, or the URL")


def _reason(error: Exception) -> str:
    return " ".join(str(getattr(error, "orig", None) or error).split())[:200]
