# SPDX-License-Identifier: MIT
"""Tables of docs/results: what a script measured replaces what stands between two marks of a page, with date and commit.

    <!-- NAME -->
    <!-- /NAME -->"""
import datetime, functools, os, pathlib, re, subprocess

ROOT = pathlib.Path(__file__).resolve().parent.parent


@functools.cache
def commit():
    """Of this checkout when first asked: "0123abc", "0123abc with changes", "unknown". What a run writes is no change."""
    def git(*words):
        run = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True)
        return run.stdout.strip() if run.returncode == 0 else ""
    changed = " with changes" if git("status", "--porcelain", "--untracked-files=no") else ""
    return (git("rev-parse", "--short", "HEAD") or "unknown") + changed


def stamp():
    """When, by which commit and on how many processors: "2026-05-04, commit 0123abc, 2 processors"."""
    return f"{datetime.datetime.now(datetime.timezone.utc):%Y-%m-%d}, commit {commit()}, {os.cpu_count()} processors"


def fill(page, name, text, note=""):
    """Puts `text`, Markdown, between the marks of `name` in the file `page`, below its stamp. Raises ValueError: no such marks."""
    path = pathlib.Path(page)
    before = path.read_text(encoding="utf-8")
    body = f"Measured {stamp()}{', ' + note if note else ''}.\n\n{text.strip()}\n"
    after, count = re.subn(rf"(<!-- {re.escape(name)} -->\n).*?(<!-- /{re.escape(name)} -->)", lambda m: m.group(1) + body + m.group(2), before, flags=re.S)
    if count != 1:
        raise ValueError(f"{page} has no place for the table: <!-- {name} --> ... <!-- /{name} -->")
    path.write_text(after, encoding="utf-8")
