#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""docs/develop/architecture.md. A newcomer's questions: twenty or more, and in each file that answers one stands what the page says to
look for. Usual changes: ten or more, each with the number of files that it names, in folders that hold such files.

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


def main():
    with open(os.path.join(ROOT, "docs", "develop", "architecture.md"), encoding="utf-8") as page:
        changes, text = page.read().split("## Twenty questions of a newcomer")
    rows = re.findall(r"^\| (.+?\?) \| [^|]*?`([^`|]+)`[^|]* \| `([^|]+)` \|$", text, re.M)
    wrong = [] if len(rows) >= 20 else [f"the page answers {len(rows)} questions"]
    if len(rows) != len(re.findall(r"^\|", text, re.M)) - 2:
        wrong.append("a row is not as the others: | question? | `file` | `what to look for` |")
    for question, file, symbol in rows:
        path = os.path.join(ROOT, file)
        if not os.path.isfile(path):
            wrong.append(f"{question} There is no {file}")
            continue
        with open(path, encoding="utf-8") as source:
            if symbol not in source.read():
                wrong.append(f"{question} {file} has no '{symbol}'")
    wrong += wrong_changes(changes.split("## Ten changes, and the files they touch")[1])
    if wrong:
        sys.exit("\n".join(wrong))


if __name__ == "__main__":
    main()
