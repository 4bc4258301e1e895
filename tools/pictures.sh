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
for picture in plate melting error_table; do
  gnuplot -e "data='$scratch/$picture.txt'; scratch='$scratch'; picture='$folder/$picture.png'" "tools/$picture.gnuplot"
  echo "$folder/$picture.png"
done
