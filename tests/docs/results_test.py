#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tables that scripts write: a page takes a table between its marks and nothing else, and every table that a script of ours writes has
a place in a page of docs/results.

    results_test.py"""
import os, re, sys, tempfile

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
sys.path.insert(0, os.path.join(ROOT, "scripts"))
sys.dont_write_bytecode = True
import results_page


def fill(text, *words):
    with tempfile.NamedTemporaryFile("w+", suffix=".md") as page:
        page.write(text)
        page.flush()
        results_page.fill(page.name, *words)
        with open(page.name, encoding="utf-8") as file:
            return file.read()


def main():
    page = "# A page\n\n<!-- a -->\nold\n<!-- /a -->\n\nbetween\n\n<!-- b -->\nstays\n<!-- /b -->\n"
    filled = fill(page, "a", "| new |\n", "seed 7")
    assert re.search(r"<!-- a -->\nMeasured \d{4}-\d\d-\d\d, commit .*, seed 7\.\n\n\| new \|\n<!-- /a -->\n", filled), filled
    assert "old" not in filled and filled.endswith("between\n\n<!-- b -->\nstays\n<!-- /b -->\n"), filled
    assert fill(filled, "a", "| new |\n", "seed 7").count("<!-- a -->") == 1
    for wrong in ("c", "a -->|<!-- b"):
        try:
            fill(page, wrong, "x")
        except ValueError:
            continue
        raise AssertionError(f"a page without '{wrong}' took its table")

    written, places = set(), set()
    for file in os.listdir(os.path.join(ROOT, "scripts")):
        path = os.path.join(ROOT, "scripts", file)
        if os.path.isfile(path):
            with open(path, encoding="utf-8") as script:
                written |= set(re.findall(r'results_page\.fill\(\w+\.page, "([\w-]+)"', script.read()))
    for file in os.listdir(os.path.join(ROOT, "docs", "results")):
        if file.endswith(".md"):
            with open(os.path.join(ROOT, "docs", "results", file), encoding="utf-8") as text:
                places |= set(re.findall(r"<!-- ([\w-]+) -->\n", text.read()))
    assert written and written <= places, f"no page of docs/results has a place for {written - places}"


if __name__ == "__main__":
    main()
