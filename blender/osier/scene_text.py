# SPDX-License-Identifier: GPL-3.0-or-later
"""The text of a scene, which is TOML: without one of its tables, or with inline tables written out."""

import re
from collections.abc import Iterator

TOKEN = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}|' r"'''.*?'{3,5}|" r'"(?:\\.|[^"\\\n])*"|' r"'[^'\n]*'|#[^\n]*|[\[\]{}\n]",
    re.DOTALL,
)
"""What decides where a statement ends: strings, comments, brackets and line ends."""

PARTS = re.compile(TOKEN.pattern + "|,", re.DOTALL)
"""What decides where a value of an inline table or an array ends: that of a statement, and commas."""

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


def first_word(statement: str) -> str:
    """The first word of the name of a table or key; empty for a blank line or a comment."""
    head = HEAD.match(statement)
    return "" if head is None else next(part for part in head.groups()[1:] if part is not None)


def without_table(text: str, name: str) -> str:
    """The text without the table `name`, those below it, and keys that give it: `name.key = 1`, `name = { key = 1 }`."""
    kept, table = [], ""
    for statement in statements(text):
        head, word = HEAD.match(statement), first_word(statement)
        if head is not None and head[1]:
            table = word
        # Keys before the first table name theirs; blank lines and comments belong to the table above them.
        if (table or word) != name:
            kept.append(statement)
    return "".join(kept)


def split(text: str) -> list[str]:
    """The parts of an inline table or an array between its commas, without comments and empty parts."""
    parts, part, depth, start = [], "", 0, 0
    for token in PARTS.finditer(text):
        mark = token[0]
        if mark[0] == "#":
            part += text[start : token.start()]
            start = token.end()
        elif mark in ("[", "{"):
            depth += 1
        elif mark in ("]", "}"):
            depth -= 1
        elif mark == "," and depth == 0:
            parts.append(part + text[start : token.start()])
            part, start = "", token.end()
    parts.append(part + text[start:])
    return [stripped for part in parts if (stripped := part.strip())]


def with_headed_tables(text: str, name: str) -> str:
    """The text with `name = [{ key = 1 }]` and `name = { key = 1 }` as tables with a header at its end, to which more can be added."""
    kept, tables, is_root = [], [], True
    for statement in statements(text):
        head, word = HEAD.match(statement), first_word(statement)
        is_root = is_root and not (head is not None and head[1])
        equals = None if head is None else re.match(r"\s*=", statement[head.end() :])
        if not is_root or word != name or equals is None:
            kept.append(statement)
            continue
        # One value, without the comment behind it.
        value = "".join(split(statement[head.end() + equals.end() :])[:1])
        if value.startswith("["):
            tables += [f"[[{name}]]\n" + "\n".join(split(item[1:-1])) + "\n" for item in split(value[1:-1])]
        else:
            tables.append(f"[{name}]\n" + "\n".join(split(value[1:-1])) + "\n")
    return "".join(kept) + "".join("\n" + table for table in tables)
