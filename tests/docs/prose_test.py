#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""How documents are written: no sentence above 25 words, no line of prose above 150 characters, and none of the words for which WORDS
has a better one.

    prose_test.py     prints what is wrong, a line each; exit status 1 if anything is"""
import os, re, sys

from pages import ROOT, pages, read

LONGEST, WIDEST = 25, 150
WORDS = {  # What documents do not say, and what they say instead.
    r"\bpreviously\b|\bformerly\b|\bused to be\b|\bin earlier versions\b": "the present (what was is in CHANGELOG.md)",
    r"\bcolor\b|\bbehavior\b|\bcenter\b|\bcalibrater\b": "British spelling",
    r"\bsimply\b|\bjust\b(?! sees| now)|\bof course\b|\bobviously\b": "nothing (the sentence says the same without it)",
    r"\blook-elsewhere price\b": "look-elsewhere penalty",
    r"\bforetold\b|\bforetells?\b": "predicted",
    r"\bmends?\b": "correct, repair",
    r"\bconnects? anew\b": "reconnect",
}
NO_SENTENCE = ("Equation:", "Equation, ", "Parameters:")  # Items of the catalogue of mechanisms.
LONG_SENTENCES = {os.path.join("docs", "method", "model.md")}  # Its sentences are definitions.


def lines_of_prose(path, with_generated=True):
    """Lines without code; empty ones in their place."""
    text = re.sub(r"^```.*?^```$", "", read(path), flags=re.S | re.M)
    if not with_generated:
        text = re.sub(r"^<!-- (\S+).*?-->$.*?^<!-- /\1 -->$", "", text, flags=re.S | re.M)
    text = re.sub(r"<!--.*?-->", "", text, flags=re.S)
    return ["" if line.startswith("    ") else line for line in text.splitlines()]


def prose(path):
    """Paragraphs and items of lists, without tables and headings."""
    paragraph = []
    for line in lines_of_prose(path) + [""]:
        line = line.strip()
        item = re.match(r"([-*]|\d+\.) ", line)
        if (not line or line.startswith(("|", "#", "!")) or item) and paragraph:
            yield " ".join(paragraph)
            paragraph = []
        if line and not line.startswith(("|", "#", "!")):
            paragraph.append(line[item.end():] if item else line)


def sentences(paragraph):
    paragraph = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", paragraph)
    paragraph = re.sub(r"`[^`]*`", "CODE", paragraph)
    return re.split(r"(?<=[.!?:])\s+(?=[A-Z*(\"0-9])", paragraph)


def main():
    wrong = []
    for page in sorted(pages()):
        name = os.path.relpath(page, ROOT)
        if name == "CHANGELOG.md" or name.startswith(os.path.join("docs", "reference", "cli")):
            continue  # One tells what was, the other is the programs' own words.
        for line in lines_of_prose(page, with_generated=False):
            if len(line) > WIDEST and not line.startswith(("|", "#", "!")) and name not in LONG_SENTENCES:
                wrong.append(f"{name}: a line of {len(line)} characters: {line[:80]}")
        for paragraph in prose(page):
            if paragraph.startswith(NO_SENTENCE):
                continue
            for sentence in sentences(paragraph):
                count = sum(1 for word in sentence.split() if re.search(r"\w", word))
                if count > LONGEST and name not in LONG_SENTENCES:
                    wrong.append(f"{name}: {count} words: {sentence[:110]}")
                for word, better in WORDS.items():
                    if found := re.search(word, sentence, re.I):
                        wrong.append(f"{name}: '{found.group(0)}': better {better}: {sentence[:110]}")
    if wrong:
        sys.exit("\n".join(wrong))


if __name__ == "__main__":
    main()
