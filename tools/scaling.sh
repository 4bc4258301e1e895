#!/usr/bin/env bash
# Counts what ranks of calor-mpi exchange, times them and weighs their memory, and writes the tables and the
# picture of docs/scaling.md: tools/scaling.sh BIN, BIN being the folder of calor and calor-mpi.

set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bin=$(realpath "$1")
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
export OMP_NUM_THREADS=1

root=()
if [[ $(id -u) == 0 ]]; then root=(--allow-run-as-root); fi

scene() {
  cat >"$scratch/plate.nml" <<END
&domain shape = 'rectangle' x_range = 0, 1 y_range = 0, 1 spacing = 0.01
  arrangement = 'jittered' jitter = 0.2 /
&initial temperature_expression = 'sin(pi*x)*sin(pi*y)' /
&boundary on = 'all' kind = 'temperature' value = 0 /
&time end = 0.001 method = 'rkl2' /
END
}

# Particles of a rank, of others within reach, and bytes: from the lines Ranks and Exchange.
numbers() {
  awk -v p="$1" '/^Ranks/ { own = $7; halo = $12 }
    /^Exchange/ { printf "%d %d %d %d %d %.2f\n", p, own, halo, $2, $15, (p > 1 ? $2/8/sqrt(own)/2.1 : 0) }'
}

scene
for p in 1 2 4 8 16 32 64; do
  mpirun --oversubscribe "${root[@]}" -n "$p" "$bin/calor-mpi" check "$scratch/plate.nml" \
    2>/dev/null | numbers "$p"
done >"$scratch/table"

{
  echo '| ranks | particles of a rank | of others within reach, at most | bytes a product, at most | on average | at most, over 8 √(N/P) h/Δ |'
  echo '|---|---|---|---|---|---|'
  awk '{ printf "| %s | %s | %s | %s | %s | %s |\n", $1, $2, $3, $4, $5, $6 }' "$scratch/table"
} >"$scratch/markdown"
awk -v table="$scratch/markdown" '
  /<!-- table -->/ { print; print ""; while ((getline line < table) > 0) print line; inside = 1; next }
  inside && /^\|/ { next }
  inside && /^$/ { next }
  inside { print ""; inside = 0 }
  { print }' docs/scaling.md >"$scratch/document"
cp "$scratch/document" docs/scaling.md

gnuplot -e "data='$scratch/table'; picture='docs/pictures/scaling.png'" tools/scaling.gnuplot
tools/rank_times.py "$bin" docs/scaling.md
