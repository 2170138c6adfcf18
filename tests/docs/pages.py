# SPDX-License-Identifier: MIT
"""The pages of this project, for the tests that read all of them."""
import os

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))


def pages():
    """Paths of all Markdown files, without those of builds and hidden folders."""
    for folder, folders, files in os.walk(ROOT):
        folders[:] = [f for f in folders if f != "build" and not f.startswith(".")]
        yield from (os.path.join(folder, f) for f in files if f.endswith(".md"))


def read(path):
    with open(path, encoding="utf-8") as file:
        return file.read()
