#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""The first user's path, as docs/operate/first-run.md tells it, carried out: every command between the marks `<!-- transcript -->` and
`<!-- /transcript -->` runs in one shell from the project's root, and what it says must be what the page shows. Figures and paths may
differ; a line `...` stands for any lines.

    transcript_test.py [--print]     --print: what the commands say now, to paste into the page"""
import os, re, shutil, subprocess, sys, threading

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
LONGEST_S = 1500
END = "@@ end of the command, status "


def transcript():
    """The commands and the lines that the page shows under each."""
    with open(os.path.join(ROOT, "docs", "operate", "first-run.md"), encoding="utf-8") as page:
        text = page.read()
    block = re.search(r"<!-- transcript -->\n(.*?)<!-- /transcript -->", text, re.S).group(1)
    steps = []
    for line in block.splitlines():
        if not line.startswith("    "):
            continue  # Prose between the commands.
        line = line[4:].rstrip()
        if line.startswith("$ "):
            steps.append((line[2:], []))
        elif steps and steps[-1][0].endswith("\\"):
            steps[-1] = (steps[-1][0][:-1] + line.strip(), [])
        else:
            steps[-1][1].append(line)
    return steps


def shape(line):
    """A line without what differs from run to run: figures, marks of time, and the folder of the project."""
    line = line.replace(ROOT, "~").rstrip()
    line = re.sub(r"[-+−]?\d[\d.,:]*(e[-+]?\d+)?", "N", line)
    return re.sub(r"\s+", " ", line).strip()


def agrees(shown, said):
    """Whether the lines said are those shown, `...` standing for any number of lines."""
    if not shown:
        return not said
    if shown[0] == "...":
        return any(agrees(shown[1:], said[k:]) for k in range(len(said) + 1))
    return bool(said) and shape(shown[0]) == shape(said[0]) and agrees(shown[1:], said[1:])


def background(command):
    """A program in the background is used once it has said that it is ready: the file it writes has a line."""
    file = os.path.join(ROOT, re.search(r">\s*(\S+) &$", command).group(1))
    for _ in range(400):
        if os.path.exists(file) and os.path.getsize(file):
            return
        threading.Event().wait(0.05)


def main(show):
    shutil.rmtree(os.path.join(ROOT, "build", "first"), ignore_errors=True)
    environment = {name: value for name, value in os.environ.items() if not name.lower().endswith("_proxy")}
    shell = subprocess.Popen(["timeout", str(LONGEST_S), "bash"], cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                             text=True, errors="replace", env=environment)
    wrong = []
    try:
        for command, shown in transcript():
            shell.stdin.write(f"{command}\nprintf '\\n{END}%s\\n' $?\n")
            shell.stdin.flush()
            if command.endswith("&"):
                background(command)
            said, status = [], None
            for line in shell.stdout:
                if line.startswith(END):
                    status = int(line[len(END):])
                    break
                said.append(line.rstrip())
            while said and not said[-1]:
                said.pop()
            if show:
                print("$ " + command, *said, sep="\n")
            if status is None:
                wrong.append(f"`{command}` did not end")
                break
            if status:
                wrong.append(f"`{command}` ended with status {status}:\n  " + "\n  ".join(said))
            elif not agrees(shown, said):
                wrong.append(f"`{command}`: the page shows\n  " + "\n  ".join(shown) + "\nbut it said\n  " + "\n  ".join(said))
    finally:
        shell.stdin.write("kill $(jobs -p)\n")
        shell.stdin.close()
        shell.wait(timeout=60)
    if wrong and not show:
        sys.exit("\n".join(wrong))


if __name__ == "__main__":
    main("--print" in sys.argv[1:])
