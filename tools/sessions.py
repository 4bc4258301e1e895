#!/usr/bin/env python3
"""Keep the sessions that the documents show true.

    tools/sessions.py [--check] [DOCUMENT ...]

A session is made of the blocks ```console of a document: lines that begin with "$ " are commands,
the others what they say. All blocks of a document are run in their order by bash in one empty
folder, where `calor` is the program in CALOR_PROGRAM (bin/calor) and `data` the folder of scenes.

Without --check the output in the document is made anew. With it nothing is written, and the exit
status is 1 if a command fails that did not, does not fail that did (its output then begins with
"calor: "), or no longer says something under the same headings: numbers may differ between
machines, so the first word of each line counts.

It also looks at the commands in blocks ```sh and in running text, `calor run ...`: those of calor
must name a command with options that there are, and scenes of data/; those of make a target.
"""

import os
import pathlib
import re
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
CALOR = pathlib.Path(os.environ.get("CALOR_PROGRAM", ROOT / "bin" / "calor")).resolve()
PATIENCE = 300  # seconds, on a busy machine


class Session:
    """A folder and the commands that are run in it."""

    def __init__(self, folder):
        self.folder = pathlib.Path(folder)
        tools = self.folder / ".tools"
        tools.mkdir()
        (tools / "calor").symlink_to(CALOR)
        (self.folder / "data").symlink_to(ROOT / "data")
        self.environment = dict(os.environ, PATH=f"{tools}:{os.environ['PATH']}", LC_ALL="C.UTF-8")

    def run(self, command):
        done = subprocess.run(
            ["bash", "-c", command], cwd=self.folder, env=self.environment, stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=PATIENCE,
        )
        return done.returncode, done.stdout.decode("utf-8", "replace").rstrip("\n")


def headings(text):
    """The first word of each line that begins at its left."""
    return [re.sub(r"[-+0-9.e]+", "#", line.split()[0]) for line in text.splitlines() if line[:1].strip()]


def blocks(lines, kind):
    """Begin and end of the blocks of a kind, without their fences."""
    start = None
    for number, line in enumerate(lines):
        if start is None and line.strip() == "```" + kind:
            start = number + 1
        elif start is not None and line.strip() == "```":
            yield start, number
            start = None


def steps(lines):
    """Commands of a block and what they said."""
    found = []
    for line in lines:
        if line.startswith("$ "):
            found.append([line[2:], []])
        elif found:
            found[-1][1].append(line)
    return [(command, "\n".join(said).rstrip("\n")) for command, said in found]


def follow(path, check):
    """Run the sessions of a document; what is wrong with them, as lines."""
    lines = path.read_text(encoding="utf-8").split("\n")
    places = list(blocks(lines, "console"))
    wrong, renewed, last = [], [], 0
    with tempfile.TemporaryDirectory(prefix="session-") as folder:
        session = Session(folder)
        for start, end in places:
            renewed += lines[last:start]
            for command, said in steps(lines[start:end]):
                status, output = session.run(command)
                failed = said.startswith("calor: ")
                if check and failed and status not in (2, 3, 4):
                    wrong.append(f"{path.name}: '{command}' should fail, but ended with status {status}: {output}")
                elif not failed and status != 0 and not output.startswith("calor: "):
                    wrong.append(f"{path.name}: '{command}' failed with status {status}: {output}")
                elif check and not failed and status != 0:
                    wrong.append(f"{path.name}: '{command}' failed with status {status}: {output}")
                elif check and headings(said) != headings(output):
                    wrong.append(f"{path.name}: '{command}' says something else now:\n{output}")
                renewed += ["$ " + command] + (output.split("\n") if output else [])
            last = end
    renewed += lines[last:]
    if not check and renewed != lines:
        path.write_text("\n".join(renewed), encoding="utf-8")
        print("renewed", path.relative_to(ROOT))
    return wrong


def commands_shown(text):
    """The commands in blocks ```sh and between single backticks, each as a list of words."""
    lines = text.split("\n")
    for start, end in blocks(lines, "sh"):
        yield from (line.split("#")[0].split() for line in lines[start:end])
    running_text = re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)
    for span in re.findall(r"`((?:bin/)?calor [^`]*|make [a-z-]+)`", running_text):
        yield span.split("|")[0].split()


def look_at_commands(path):
    """What is wrong with the commands of a document that are not run."""
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"^([a-z-]+):", makefile, re.M))
    wrong = []
    for words in commands_shown(path.read_text(encoding="utf-8")):
        if words[:1] == ["make"]:
            for word in words[1:]:
                if re.fullmatch(r"[a-z-]+", word) and word not in targets:
                    wrong.append(f"{path.name}: make has no target '{word}'")
        elif words and words[0] in ("calor", "bin/calor") and words[1][0] not in "-C":
            help_text = subprocess.run([CALOR, words[1], "--help"], capture_output=True, check=False)
            if help_text.returncode != 0:
                wrong.append(f"{path.name}: there is no 'calor {words[1]}'")
            for word in words[2:]:
                if word.startswith("--") and word.split("=")[0].encode() not in help_text.stdout:
                    wrong.append(f"{path.name}: calor {words[1]} has no option {word}")
                if word.startswith("data/") and not (ROOT / word).exists():
                    wrong.append(f"{path.name}: there is no {word}")
    return wrong


def main():
    words = sys.argv[1:]
    check = "--check" in words
    named = [ROOT / word for word in words if word != "--check"]
    wrong = []
    for path in named or [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]:
        wrong += follow(path, check) + look_at_commands(path)
    print("\n".join(wrong), end="\n" if wrong else "", file=sys.stderr)
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
