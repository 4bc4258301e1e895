#!/usr/bin/env bash
# Shows that effects cost a scene without them nothing: tools/absent_effects.sh
#
# Builds the program twice, once as it is and once from a copy from which the modules of all effects
# and their lines in the table are left out, and counts with valgrind the instructions that the steps
# of a plain plate take: those of a longer run less those of a shorter one, both of steps of the same
# length. The status is 1 if the two counts differ by more than 1 %.

set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

readonly work=build/absent-effects
readonly fpm=$PWD/.venv/bin/fpm
# Instructions that valgrind knows, whatever the machine has
readonly flags='-O3 -march=x86-64-v2'
export OMP_NUM_THREADS=1

command -v valgrind >/dev/null || {
  [[ $(id -u) == 0 ]] || { echo 'valgrind is missing: install it and run this again' >&2; exit 1; }
  { apt-get -qq update && apt-get -qq --yes install --no-install-recommends valgrind; } >build/apt.log 2>&1
}

# Builds the program in folder $1.
build() {
  mkdir -p "$work/$1/build"
  rm -rf "$work/$1/src" "$work/$1/app"
  cp -r src app fpm.toml "$work/$1"
  # Neither the tests' dependency nor the benchmark is wanted here.
  sed -i -e '/^\[dev-dependencies\]/,$d' -e '/^\[\[example\]\]/,/^$/d' "$work/$1/fpm.toml"
  if [[ $1 == without ]]; then
    # Melting stays out of the table only: the laws of heat contents ask for its type.
    find "$work/$1/src/effects" \( -name 'calor_effect_*' -o -name 'calor_*_exchange.f90' \) \
      ! -name calor_effect_melting.f90 -delete
    # From the table: the lines of effects, continued ones with what follows them
    sed -i -e '/use calor_effect_/d' -e '/call enter(table,/{:a;/&$/{N;ba};d}' \
      "$work/$1/src/effects/calor_effects.f90"
  fi
  (cd "$work/$1" && "$fpm" build --flag "$flags" --link-flag '-Wl,--as-needed' >build.log 2>&1) ||
    { tail -n 20 "$work/$1/build.log" >&2; exit 1; }
}

# Prints the instructions of a run of program $1 to time $2, s.
instructions() {
  sed -e "s|^&time .*|\&time end = $2  step = 0.0001  method = 'runge_kutta_4' /|" -e '/^&output/,$d' \
    data/plate.nml >"$work/plate.nml"
  valgrind --tool=callgrind --callgrind-out-file=/dev/null "$1" run "$work/plate.nml" 2>&1 >/dev/null |
    sed -n 's/.*Collected : *//p'
}

declare -A steps
for kind in with without; do
  build "$kind"
  program=$(find "$work/$kind/build" -path '*app/calor' -type f -printf '%T@ %p\n' | sort -n | tail -n 1)
  short=$(instructions "${program#* }" 0.01)
  long=$(instructions "${program#* }" 0.02)
  steps[$kind]=$(((long - short) / 100))
  echo "$kind effects' modules: ${steps[$kind]} instructions a step"
done
awk -v a="${steps[with]}" -v b="${steps[without]}" 'BEGIN {
  printf "difference: %.4f %%\n", 100 * (a - b) / b
  exit (a - b > 0.01 * b || b - a > 0.01 * b)
}'
