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
"$examples/error_table" >"$scratch/error_table.txt"
for picture in plate error_table; do
  gnuplot -e "data='$scratch/$picture.txt'; scratch='$scratch'; picture='$folder/$picture.png'" "tools/$picture.gnuplot"
  echo "$folder/$picture.png"
done
