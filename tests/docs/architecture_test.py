#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""docs/develop/architecture.md. A newcomer's questions: twenty or more, and in each file that answers one stands what the page says to
look for. Usual changes: ten or more, each with the number of files that it names, in folders that hold such files.
docs/develop/why-an-answer.md. Ten questions or more, each with files in which stands what the page says to look for.

    architecture_test.py     prints what is wrong, a line each; exit status 1 if anything is"""
import os, re, sys

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))


def wrong_changes(text):
    """What is wrong with the table of usual changes. A cell names its files in backticks, or says "its test"."""
    rows = [line.strip("|").split("|") for line in text.splitlines() if line.startswith("|")][2:]
    if len(rows) < 10:
        yield f"the page has {len(rows)} changes"
    before = ""
    for what, *cells, files, _ in rows:
        named = before if any("the same" in cell for cell in cells) else " ".join(cells)
        before = named
        paths = re.findall(r"`([^`]+)`", named)
        count = len(paths) + named.count("its test")
        if count != int(files):
            yield f"{what.strip()}: {count} files are named, and {files.strip()} counted"
        for path in paths:
            folder, name = os.path.split(path)
            alike = [] if not os.path.isdir(os.path.join(ROOT, folder)) else os.listdir(os.path.join(ROOT, folder))
            if not (os.path.exists(os.path.join(ROOT, path)) or
                    name.startswith("NAME") and any(file.endswith(name[len("NAME"):]) for file in alike)):
                yield f"{what.strip()}: there is no {path}"


def without_symbol(rows):
    """What is wrong with rows of (what it is about, file, symbol): a symbol stands in its file as a whole word."""
    for what, file, symbol in rows:
        path = os.path.join(ROOT, file)
        if not os.path.isfile(path):
            yield f"{what} There is no {file}"
            continue
        with open(path, encoding="utf-8") as source:
            if not re.search(r"(?<!\w)" + re.escape(symbol) + r"(?!\w)", source.read()):
                yield f"{what} {file} has no '{symbol}'"


def wrong_answers(text):
    """What is wrong with the questions about an answer: each has a table of what is decided where."""
    _, *questions = re.split(r"^## ", text, flags=re.M)
    if len(questions) < 10:
        yield f"the page has {len(questions)} questions about an answer"
    for question in questions:
        title, _, rest = question.partition("\n")
        rows = re.findall(r"^\| ([^|]+) \| `([^`|]+)` \| `([^`|]+)` \|$", rest, re.M)
        if not rows or len(rows) != len(re.findall(r"^\|", rest, re.M)) - 2:
            yield f"{title} Its rows are not: | what it decides | `file` | `what to look for` |"
        yield from without_symbol((title, file, symbol) for _, file, symbol in rows)


def page(name):
    with open(os.path.join(ROOT, "docs", "develop", name), encoding="utf-8") as text:
        return text.read()


def main():
    changes, text = page("architecture.md").split("## Twenty questions of a newcomer")
    rows = re.findall(r"^\| (.+?\?) \| [^|]*?`([^`|]+)`[^|]* \| `([^|]+)` \|$", text, re.M)
    wrong = [] if len(rows) >= 20 else [f"the page answers {len(rows)} questions"]
    if len(rows) != len(re.findall(r"^\|", text, re.M)) - 2:
        wrong.append("a row is not as the others: | question? | `file` | `what to look for` |")
    wrong += without_symbol(rows)
    wrong += wrong_answers(page("why-an-answer.md"))
    wrong += wrong_changes(changes.split("## Ten changes, and the files they touch")[1])
    if wrong:
        sys.exit("\n".join(wrong))


if __name__ == "__main__":
    main()
