"""ROS 2 bags in SQLite (``.db3``): a table of topics, a table of messages."""

import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from ftbias_jax.io.budget import MAX_CHUNK, Budget, UnpackError, unpack_message
from ftbias_jax.io.ros.raw import UNDEFINED, Definition, OnDamage, RawMessage, plain_type

MAGIC = b"SQLite format 3\x00"
STEPS, A_RECORD = 1000, 10
"""Steps of SQLite's virtual machine between checks of the budget, and steps that reading a message takes."""
SHORTEST = 1 << 16
"""Bytes that a value may have even in the smallest file, because SQLite's own statements count as well."""
MAX_STEP = 1 << 20
"""Most messages skipped in one step of the search for readable ones; the step doubles with every failure."""

_SELECT = "SELECT id, topic_id, timestamp, data FROM messages WHERE id > ? ORDER BY id"
_WANTED = "SELECT count(*) FROM sqlite_master WHERE type = 'table' AND name IN ('topics', 'messages')"
_DEFINED = "SELECT count(*) FROM sqlite_master WHERE type = 'table' AND name = 'message_definitions'"


def scan_sqlite(path: str | os.PathLike[str], on_damage: OnDamage, budget: Budget) -> Iterator[RawMessage]:
    """Yield all messages of a bag; damage is reported to ``on_damage`` and skipped."""
    # A killed recorder leaves its last messages in a write-ahead log (-wal); without one the file counts as immutable.
    mode = "ro" if Path(f"{os.fspath(path)}-wal").exists() else "ro&immutable=1"
    try:
        with closing(sqlite3.connect(f"{Path(path).absolute().as_uri()}?mode={mode}", uri=True)) as database:
            database.execute("PRAGMA trusted_schema = OFF")
            database.execute("PRAGMA writable_schema = ON")  # allows opening a truncated database; nothing is written
            database.text_factory = bytes  # names may be damaged, so they are decoded below
            # In a damaged file pages may reference each other, so the file's size limits both values and time.
            database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, max(min(MAX_CHUNK, budget.size), SHORTEST))
            database.set_progress_handler(lambda: _spent(budget), STEPS)
            if database.execute(_WANTED).fetchone() != (2,):  # a view of that name could compute endlessly
                on_damage("has no tables topics and messages")
                return
            topics, definitions = _topics(database, budget), _definitions(database, budget)
            for topic_id, logged, data in _rows(database, on_damage, budget):
                topic = topics.get(topic_id)
                if topic is None or not isinstance(logged, int) or not isinstance(data, bytes):
                    on_damage("a message has no topic, no time or no data")
                    continue
                try:
                    definition = definitions.get(topic[1], UNDEFINED)
                    yield RawMessage(*topic, logged, unpack_message(data, budget), definition)
                except UnpackError as error:
                    on_damage(f"a message {error}")
    except (sqlite3.Error, sqlite3.Warning, UnicodeDecodeError, OverflowError) as error:
        on_damage(f"is not a whole SQLite database: {error}")


def _topics(database: sqlite3.Connection, budget: Budget) -> dict[object, tuple[str, str, str]]:
    """Name, type and encoding of each topic, by its id."""
    texts = {}
    for identity, *row in database.execute("SELECT id, name, type, serialization_format FROM topics"):
        budget.count()
        if isinstance(identity, int) and all(isinstance(text, bytes) for text in row):  # SQLite allows any type here
            texts[identity] = [text.decode() for text in row]
    return {identity: (name, plain_type(kind), encoding) for identity, (name, kind, encoding) in texts.items()}


def _definitions(database: sqlite3.Connection, budget: Budget) -> dict[str, Definition]:
    """Definitions of message types, by plain name; {} before ROS 2 Iron."""
    found = {}
    try:
        if database.execute(_DEFINED).fetchone() != (1,):
            return {}
        for row in database.execute("SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"):
            budget.count()
            if all(isinstance(text, bytes) for text in row):
                budget.unpack(sum(map(len, row)))
                kind, language, text = (text.decode(errors="replace") for text in row)
                found[plain_type(kind)] = Definition(language, text)
    except sqlite3.DatabaseError:  # the messages that are left can be read without definitions
        budget.count(0)
    return found


def _rows(database: sqlite3.Connection, on_damage: OnDamage, budget: Budget) -> Iterator[tuple[object, object, object]]:
    """Topic id, time and data of the messages, in the order of their ids."""
    last, step = -1, 0
    while step <= MAX_STEP:
        try:
            for number, topic, logged, data in database.execute(_SELECT, (last,)):
                budget.count()
                budget.unpack(len(data) if isinstance(data, bytes) else 0)
                if not isinstance(number, int) or number <= last:
                    on_damage(f"cannot be read after message {last}: the numbers of the messages do not increase")
                    return
                last, step = number, 0
                yield topic, logged, data
            return
        except sqlite3.DatabaseError as error:
            budget.count()  # a spent budget is what interrupts a statement
            step = 2 * step or 1
            if step == 1:
                on_damage(f"cannot be read after message {last}: {error}")
            last += step


def _spent(budget: Budget) -> bool:
    """Whether a statement is to be interrupted because it takes more steps than reading all messages could."""
    budget.records -= STEPS // A_RECORD
    return budget.records < 0
