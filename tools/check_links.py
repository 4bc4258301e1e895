#!/usr/bin/env python3
"""See that links between the documents lead somewhere: tools/check_links.py DOCUMENT ...

A link to a file must lead to one that is there, a link
to a heading, #so, to a heading of that document. Links to other hosts are not followed. Prints what
is wrong; the exit status is 1 if anything is.
"""

import pathlib
import re
import sys

LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")


def text_of(path):
    """A document without its blocks of code, in which brackets mean other things."""
    return re.sub(r"^```.*?^```$", "", path.read_text(encoding="utf-8"), flags=re.M | re.S)


def anchors(path):
    """What the headings of a document are called in links."""
    found = set()
    for heading in re.findall(r"^#+ +(.*)$", text_of(path), re.M):
        words = re.sub(r"[^\w\- ]", "", heading.strip().lower())
        found.add(words.replace(" ", "-"))
    return found | set(re.findall(r"<a id=\"([^\"]+)\">", text_of(path)))


def main():
    wrong = []
    for name in sys.argv[1:]:
        path = pathlib.Path(name)
        text = re.sub(r"`[^`\n]*`", "", text_of(path))
        for link in LINK.findall(text):
            if re.match(r"[a-z]+:", link):
                continue
            file, _, anchor = link.partition("#")
            target = path.parent / file if file else path
            if not target.exists():
                wrong.append(f"{name}: there is no {link}")
            elif anchor and target.suffix == ".md" and anchor not in anchors(target):
                wrong.append(f"{name}: {target} has no heading #{anchor}")
    print("\n".join(wrong), end="\n" if wrong else "")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
