#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Documents hold together: every relative link and anchor leads somewhere, every path of this project that a page names exists, every
page that a program names too, and every page can be reached from docs/README.md.

    links_test.py     prints what is wrong, a line each; exit status 1 if anything is"""
import os, re, sys

from pages import ROOT, pages, read

TOP = ("fit", "lidar", "rig", "sim", "procedures", "tests", "docs", "scripts", "cmake")
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
PATH = re.compile(r"(?<![\w/.:~-])((?:%s)/[\w./-]*\w)" % "|".join(TOP))
PLACEHOLDER = re.compile(r"[A-Z]{3,}")  # scripts/NAME, rig/stage/languages/NAME.cpp
NOT_OURS = re.compile(r"^(rig|rig-sim)/\d|^rig/rig$")  # rig-hdf5/1 and the like


def without_code(text):
    return re.sub(r"^ {4}.*$", "", re.sub(r"^```.*?^```$", "", text, flags=re.S | re.M), flags=re.M)


def anchors(path):
    """What GitHub calls the headings of a page."""
    seen, out = {}, set()
    for title in re.findall(r"^#{1,6} (.+)$", re.sub(r"^```.*?^```$", "", read(path), flags=re.S | re.M), re.M):
        title = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", title.replace("`", ""))
        name = re.sub(r"[^\w\- ]", "", title.strip().lower()).replace(" ", "-")
        number = seen.get(name, 0)
        seen[name] = number + 1
        out.add(name if number == 0 else f"{name}-{number}")
    return out


def exists(path):
    """A file or folder, also without its ending: fit/explain/reduce stands for reduce.hpp and reduce.cpp."""
    whole = os.path.join(ROOT, path)
    return os.path.exists(whole) or any(os.path.exists(whole + end) for end in (".hpp", ".cpp", ".py"))


def documents_in_sources():
    """(file, page) for every docs/...md that a comment or a message of a program names."""
    for top in ("rig", "sim", "lidar", "procedures", "scripts", "tests", "cmake"):
        for folder, folders, files in os.walk(os.path.join(ROOT, top)):
            folders[:] = [f for f in folders if f != "corpus"]
            for file in files:
                try:
                    text = read(os.path.join(folder, file))
                except UnicodeDecodeError:
                    continue
                for path in set(re.findall(r"(?<![\w/.-])docs/[\w/-]+\.md", re.sub(r"\w+\.\w+/[\w/-]+, docs/\S+", "", text))):
                    yield os.path.relpath(os.path.join(folder, file), ROOT), path


def main():
    wrong, linked = [], {}
    for page in sorted(pages()):
        name, text = os.path.relpath(page, ROOT), read(page)
        linked[page] = set()
        for target in LINK.findall(without_code(text)):
            if re.match(r"[a-z]+:", target):
                continue
            file, _, anchor = target.partition("#")
            where = os.path.normpath(os.path.join(os.path.dirname(page), file)) if file else page
            if not os.path.exists(where):
                wrong.append(f"{name}: the link to {target} leads nowhere")
                continue
            if anchor and where.endswith(".md") and anchor not in anchors(where):
                wrong.append(f"{name}: {os.path.relpath(where, ROOT)} has no heading '{anchor}'")
            linked[page].add(where)
        for path in sorted(set(PATH.findall(LINK.sub("", text)))):
            if not PLACEHOLDER.search(path) and not NOT_OURS.match(path) and not exists(path):
                wrong.append(f"{name}: there is no {path}")
    for name, path in documents_in_sources():
        if not exists(path):
            wrong.append(f"{name}: there is no {path}")
    reached, todo = set(), [os.path.join(ROOT, "docs", "README.md")]
    while todo:
        page = todo.pop()
        if page not in reached:
            reached.add(page)
            todo += [each for each in linked.get(page, ()) if each.endswith(".md")]
    for page in sorted(linked):
        if page.startswith(os.path.join(ROOT, "docs")) and page not in reached:
            wrong.append(f"{os.path.relpath(page, ROOT)}: no page leads here from docs/README.md")
    if wrong:
        sys.exit("\n".join(wrong))


if __name__ == "__main__":
    main()
