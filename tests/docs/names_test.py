#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Names in code. No two types of one namespace have one name, which a linker would take for one (the rule of one definition). And
names are the field's: no identifier is made with a word for which docs/develop/glossary.md has a better one.

    names_test.py     prints what is wrong, a line each; exit status 1 if anything is wrong"""
import os, re, sys

from pages import ROOT, read

TOP = ("fit", "lidar", "rig", "sim", "tests", "docs/examples")
WORDS = {  # Parts of names, between underlines and capitals, and what they are instead.
    "told": "reported, stated", "tell": "report, say", "tells": "reports, says", "foretold": "predicted", "foretell": "predict",
    "mend": "correct, repair", "mends": "corrects, repairs", "mended": "corrected, repaired",
}
APART = re.compile(r"tells?(_\w+)?_apart")  # To tell two things apart is English.


def code(text):
    """Without comments and texts."""
    text = re.sub(r"//[^\n]*", "", text)
    text = re.sub(r'R"(\w*)\(.*?\)\1"', '""', text, flags=re.S)
    return re.sub(r'"(\\.|[^"\\\n])*"', '""', text)


def names():
    """(file, identifier), each once a file."""
    for top in TOP:
        for folder, _, files in os.walk(os.path.join(ROOT, top)):
            for file in sorted(files):
                if file.endswith((".cpp", ".hpp")):
                    path = os.path.join(folder, file)
                    where = os.path.relpath(path, ROOT)
                    for name in sorted(set(re.findall(r"\b[A-Za-z_]\w*\b", code(read(path)))) | {file.rsplit(".", 1)[0]}):
                        yield where, name


def types(text):
    """Types that a file defines, with their namespaces; without those of unnamed namespaces and of other types."""
    around = []
    for word in re.finditer(r"namespace\s+([\w:]*)\s*\{|\b(?:struct|class|union)\s+(\w+)\s*(?:final\s*)?(?::(?!:)[^{;]*)?\{|\{|\}", text):
        if word.group(0).startswith("namespace"):
            around.append(word.group(1) or "unnamed")
        elif word.group(0) == "}":
            around = around[:-1]
        else:
            if word.group(2) and "unnamed" not in around and "" not in around:
                yield "::".join([*around, word.group(2)])
            around.append("")


def twice():
    """Types that two files define, for programs that are linked together: tests are programs of their own."""
    seen = {}
    for top in ("fit", "lidar", "rig", "sim"):
        for folder, _, files in os.walk(os.path.join(ROOT, top)):
            for file in files:
                if file.endswith((".cpp", ".hpp")):
                    path = os.path.join(folder, file)
                    for name in types(code(read(path))):
                        seen.setdefault(name, []).append(os.path.relpath(path, ROOT))
    return [f"{name} is defined in {' and in '.join(sorted(where))}" for name, where in seen.items() if len(where) > 1]


def main():
    wrong = twice()
    for where, name in names():
        parts = re.findall(r"[A-Z]?[a-z]+", name)
        found = [part.lower() for part in parts if part.lower() in WORDS]
        if not found or APART.search(name):
            continue
        wrong.append(f"{where}: {name}: better {WORDS[found[0]]}")
  
    if wrong:
        sys.exit("\n".join(wrong))


if __name__ == "__main__":
    main()
