#!/usr/bin/env bash
# Indents Fortran sources: tools/format.sh [--check] FOLDER...
# With --check nothing is written; files that are not in order are named, and the status is 1.

set -euo pipefail

indent() { .venv/bin/findent -ifree -i2 -c2 -k- <"$1"; }

check=0
if [[ ${1:-} == --check ]]; then
  check=1
  shift
fi
(($# > 0)) || exit 0

status=0
while IFS= read -r -d '' file; do
  if indent "$file" | cmp --silent - "$file"; then continue; fi
  if [[ $check == 1 ]]; then
    printf '%s: not in order. "make format" would change:\n' "$file" >&2
    indent "$file" | diff "$file" - | head -n 10 >&2 || true
    status=1
  else
    indented=$(indent "$file"; printf x)
    printf '%s' "${indented%x}" >"$file"
    echo "formatted $file"
  fi
done < <(find "$@" -name '*.f90' -print0 | sort -z)
exit "$status"
