# SPDX-License-Identifier: GPL-3.0-or-later
"""The text of a scene, which is TOML, without one of its tables."""

import re
from collections.abc import Iterator

TOKEN = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}|' r"'''.*?'{3,5}|" r'"(?:\\.|[^"\\\n])*"|' r"'[^'\n]*'|#[^\n]*|[\[\]{}\n]",
    re.DOTALL,
)
"""What decides where a statement ends: strings, comments, brackets and line ends."""

HEAD = re.compile(r'\s*(\[{0,2})\s*(?:"([^"\n]*)"|' r"'([^'\n]*)'|([\w-]+))", re.ASCII)
"""The brackets of a table's name, if any, and the first word of that name or of a key: quoted or bare."""


def statements(text: str) -> Iterator[str]:
    """The lines of TOML; those of a value over several lines, such as an array, are one statement."""
    start = depth = 0
    for token in TOKEN.finditer(text):
        mark = token[0]
        if mark in ("[", "{"):
            depth += 1
        elif mark in ("]", "}"):
            depth -= 1
        elif mark == "\n" and depth <= 0:
            yield text[start : token.end()]
            start = token.end()
    yield text[start:]


def without_table(text: str, name: str) -> str:
    """The text without the table `name`, those below it, and keys that give it: `name.key = 1`, `name = { key = 1 }`."""
    kept, table = [], ""
    for statement in statements(text):
        head = HEAD.match(statement)
        word = "" if head is None else next(part for part in head.groups()[1:] if part is not None)
        if head is not None and head[1]:
            table = word
        # Keys before the first table name theirs; blank lines and comments belong to the table above them.
        if (table or word) != name:
            kept.append(statement)
    return "".join(kept)
