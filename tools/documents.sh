#!/usr/bin/env bash
# Keeps what the documents quote equal to what the programs say: tools/documents.sh [--check|DOCUMENT]
#
# A document marks a quotation by a comment before it and one after it:
#
#   <!-- text: scene_reference domain -->    words of the program, which --check compares
#   <!-- sample: calor check SCENE -->       an example of output, which may differ between machines
#   <!-- table: error_table -->              measured numbers, a Markdown table
#   <!-- study: hard_cases all -->           the same where it takes minutes
#   <!-- end -->
#
# The first word is calor, a program of example/, or cat for a file that is quoted whole. Without
# --check the quotations are made anew; with it nothing is written, and the status is 1 if a text
# differs. The programs are looked for in CALOR_PROGRAM and CALOR_EXAMPLES, which make sets. A study
# is made anew only where CALOR_KINDS says so, a list such as 'table|study'.

set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

readonly calor=${CALOR_PROGRAM:-bin/calor}
readonly examples=${CALOR_EXAMPLES:-build/examples}

# Prints what the command $1 says.
quotation() {
  local words
  read -ra words <<<"$1"
  case ${words[0]} in
    calor) "$calor" "${words[@]:1}" ;;
    cat) cat "${words[@]:1}" ;;
    *) "$examples/${words[0]}" "${words[@]:1}" ;;
  esac
}

# Prints document $1 with its quotations made anew; $2: the kinds of quotation to make, as in text|table.
renewed() {
  local line kind inside=0
  while IFS= read -r line; do
    if [[ $line =~ ^'<!-- '($2)': '(.*)' -->'$ ]]; then
      kind=${BASH_REMATCH[1]}
      printf '%s\n' "$line"
      if [[ $kind == @(table|study) ]]; then printf '\n'; else printf '```text\n'; fi
      quotation "${BASH_REMATCH[2]}" </dev/null || return 1
      if [[ $kind == @(table|study) ]]; then printf '\n'; else printf '```\n'; fi
      inside=1
    elif [[ $line == '<!-- end -->' ]]; then
      inside=0
      printf '%s\n' "$line"
    elif [[ $inside == 0 ]]; then
      printf '%s\n' "$line"
    fi
  done <"$1"
  if [[ $inside == 1 ]]; then
    echo "$1: a quotation has no <!-- end -->" >&2
    return 1
  fi
}

status=0
documents=(README.md docs/*.md)
if [[ ${1:-} == *.md ]]; then documents=("$1"); fi
for document in "${documents[@]}"; do
  if [[ ${1:-} == --check ]]; then
    text=$(renewed "$document" text && printf x) || exit 1
    if ! diff "$document" - <<<"${text%$'\n'x}" >&2; then
      echo "$document quotes what the program no longer says: run make documents" >&2
      status=1
    fi
  else
    text=$(renewed "$document" "${CALOR_KINDS:-text|sample|table}" && printf x) || exit 1
    if ! cmp --silent "$document" - < <(printf '%s' "${text%x}"); then
      printf '%s' "${text%x}" >"$document"
      echo "renewed $document"
    fi
  fi
done
exit "$status"
