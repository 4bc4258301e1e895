#!/usr/bin/env bash
# Copies a program that fpm built into a folder, if it changed: fpm's `--runner "tools/place.sh FOLDER"`.

set -euo pipefail
mkdir -p "$1"
exec install -C -t "$1" "$2"
