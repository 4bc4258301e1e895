#!/usr/bin/env python3
"""Puts the tables and the picture of a whole `make bench` into the documentation.

    bench/put_tables.py MEASURED DOCS

MEASURED is the folder that bench.py wrote; in DOCS/speed.md the tables go between the lines
'<!-- bench -->' and '<!-- end -->'.
"""

import os
import shutil
import sys

measured, docs = sys.argv[1:3]
path = os.path.join(docs, "speed.md")
with open(path) as file:
    text = file.read()
begin, end = "<!-- bench -->\n", "<!-- end -->"
before, rest = text.split(begin, 1)
after = rest.split(end, 1)[1]
with open(os.path.join(measured, "speed.md")) as file:
    tables = file.read()
with open(path, "w") as file:
    file.write(before + begin + "\n" + tables + "\n" + end + after)
shutil.copy(os.path.join(measured, "speed.png"), os.path.join(docs, "pictures", "speed.png"))
