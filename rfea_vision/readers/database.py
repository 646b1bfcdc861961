"""Pressure logs from a database, through SQLAlchemy: SQLite by default, any server that has a URL."""

from __future__ import annotations

import os
from pathlib import Path

import pandas as pd

from rfea_vision.errors import InputError
from rfea_vision.readers.tables import Table, frame_table


def read_query(url: str, query: str, folder: Path = Path()) -> Table:
    """Run a query and return its rows as columns.

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
        path = (folder / (parsed.database or "")).resolve()
        if not path.is_file():  # SQLite would make an empty database in its place
            raise InputError(f"pressure.url: no database '{parsed.database}' in {folder}; correct the path")
        parsed = parsed.set(database=f"file:{path}", query={"mode": "ro", "uri": "true"})
    try:
        engine = sqlalchemy.create_engine(parsed)
    except ImportError as error:
        raise InputError(f"pressure.url: {shown} needs the Python module '{error.name}'; install it") from error
    except exc.SQLAlchemyError as error:
        raise InputError(f"pressure.url: {shown}: {_reason(error)}; correct the URL") from error
    try:
        with engine.connect() as connection:
            answer = connection.execute(sqlalchemy.text(query))
            frame = pd.DataFrame(answer.fetchall(), columns=list(answer.keys()))
    except exc.SQLAlchemyError as error:
        fault = f"pressure.query: {shown} refuses it ({_reason(error)})"
        raise InputError(f"{fault}; correct the query, or the URL") from error
    finally:
        engine.dispose()
    if frame.empty:
        raise InputError(f"pressure.query: {shown} returns no rows; correct the query")
    return frame_table(shown, frame)


def _reason(error: Exception) -> str:
    return " ".join(str(getattr(error, "orig", None) or error).split())[:200]
