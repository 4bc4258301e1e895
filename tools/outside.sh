#!/usr/bin/env bash
# Sees that calor can be used from outside: tools/outside.sh FLAGS LINK_FLAGS
#
#   - fpm install, called by hand, puts a calor in place that needs nothing of this folder,
#   - make install adds the manual page and the completion, and both are found from there,
#   - what the README says about building by hand works (of the tests, one suite is run),
#   - example-project, a project of its own, builds calor as a dependency and gets right numbers.
#
# FLAGS and LINK_FLAGS are those of the program's own build, which fpm install then uses again.

set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

readonly flags=$1 link_flags=$2
readonly fpm=$PWD/.venv/bin/fpm root=$PWD
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

fail() {
  printf '%s\n' "$*" >&2
  exit 1
}

# A calor at $1 that lists, writes, runs and completes, in an empty folder.
check_program() {
  local calor=$1
  rm -rf "$scratch/work" && mkdir "$scratch/work" && cd "$scratch/work"
  "$calor" --version >/dev/null || fail "$calor does not start"
  "$calor" new | grep >/dev/null '^  rotating_disc ' || fail "$calor does not list its starting scenes"
  "$calor" new slab >/dev/null && "$calor" run --quiet slab.nml || fail "$calor does not run"
  [[ -s slab.vtkhdf ]] || fail "$calor has written nothing"
  "$calor" completion | bash -n || fail "the completion of $calor is no bash"
  "$calor" manual | grep >/dev/null '^\.TH' || fail "$calor has no manual"
  cd "$root"
}

"$fpm" install --prefix "$scratch/fpm" --flag "$flags" --link-flag "$link_flags" >"$scratch/log" 2>&1 ||
  { tail -n 20 "$scratch/log" >&2; fail 'fpm install failed'; }
check_program "$scratch/fpm/bin/calor"

make --no-print-directory install PREFIX="$scratch/make" >"$scratch/log" 2>&1 ||
  { tail -n 20 "$scratch/log" >&2; fail 'make install failed'; }
check_program "$scratch/make/bin/calor"
[[ -s $scratch/make/share/man/man1/calor.1 ]] || fail 'there is no manual page'
# Bash finds the completion there by the name of the command.
completed=$(bash -c "PATH='$scratch/make/bin':\$PATH
  source '$scratch/make/share/bash-completion/completions/calor'
  COMP_WORDS=(calor new rot) COMP_CWORD=2
  _calor
  echo \"\${COMPREPLY[*]}\"")
[[ $completed == rotating_disc ]] || fail "bash completes 'calor new rot' to '$completed'"

{ sed -n '/^## Building by hand/,/^## /p' README.md | sed -n '/^```sh/,/^```/p' | grep -v '^```' |
  sed 's/fpm test .*/& -- text/'; } >"$scratch/by_hand"
grep -q 'fpm test .* -- text' "$scratch/by_hand" || fail 'the README does not tell how to build by hand'
bash -e "$scratch/by_hand" >"$scratch/log" 2>&1 ||
  { tail -n 20 "$scratch/log" >&2; fail 'what the README says about building by hand fails'; }

cd example-project
said=$("$fpm" run --flag '-O1' -- "$root/data/plate.nml" 2>"$scratch/log") ||
  { tail -n 20 "$scratch/log" >&2; fail 'the outside project does not build or run'; }
# exp(-π²/10) = 0.3727 and -2π² = -19.74, with the error of 40 spacings a side
grep -qE 'warmest particle +0\.37' <<<"$said" || fail "the outside project says: $said"
grep -qE 'temperature +-19\.[67]' <<<"$said" || fail "the outside project says: $said"
echo 'calor installs, and serves a project outside.'
