#!/usr/bin/env bash
# Draws the pictures of the documentation from what calor computes: tools/pictures.sh EXAMPLES FOLDER
#
# EXAMPLES holds the programs of example/; the pictures go into FOLDER.

set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
readonly examples=$1 folder=$2
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

mkdir -p "$folder"
"$examples/field_as_text" data/plate.nml >"$scratch/plate.txt"
"$examples/field_as_text" data/melting.nml >"$scratch/melting.txt"
# Of the rows with h/Δ = 2.1 those of the lattice and of jitter 0.2: jitter, 1/Δ, both schemes' errors
"$examples/error_table" | awk -F '[|/]' '$1 == "" && $3 == 2.1 && ($2 == 0 || $2 == 0.2) {
  for (level = 0; level < 3; level++) print $2, 20*2^level, $(4 + level), $(7 + level) }' \
  >"$scratch/error_table.txt"
# Every shape in every arrangement; after no time at all walls are at 1 and what is inside at 0
declare -Ar shapes=(
  [rectangle]='x_range = -1, 1  y_range = -1, 1'
  [disc]='radius = 1'
  [annulus]='radius = 1  inner_radius = 0.4'
  [polygon]='vertices = -1,-1, 1,-1, 1,0, 0.2,0.3, 0,1, -1,1  hole_vertices = -0.6,-0.6, 0,-0.6, -0.6,0'
)
for shape in "${!shapes[@]}"; do
  for arrangement in lattice hexagonal jittered relaxed; do
    cat >"$scratch/shape.nml" <<SCENE
&domain shape = '$shape'  ${shapes[$shape]}  spacing = 0.1  arrangement = '$arrangement' /
&boundary value = 1 /
&time end = 1e-9 /
SCENE
    "$examples/field_as_text" "$scratch/shape.nml" >"$scratch/${shape}_$arrangement.txt"
  done
done
for picture in plate melting error_table shapes; do
  gnuplot -e "data='$scratch/$picture.txt'; scratch='$scratch'; picture='$folder/$picture.png'" "tools/$picture.gnuplot"
  echo "$folder/$picture.png"
done
"$examples/convergence_table" "$folder/convergence.png" >/dev/null
echo "$folder/convergence.png"
