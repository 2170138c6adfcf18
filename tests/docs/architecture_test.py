#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""A newcomer's questions in docs/develop/architecture.md: twenty or more, and in each file that answers one stands what the page says
to look for.

    architecture_test.py     prints what is wrong, a line each; exit status 1 if anything is"""
import os, re, sys

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))


def main():
    with open(os.path.join(ROOT, "docs", "develop", "architecture.md"), encoding="utf-8") as page:
        text = page.read().split("## Twenty questions of a newcomer")[1]
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
    if wrong:
        sys.exit("\n".join(wrong))


if __name__ == "__main__":
    main()
