#!/usr/bin/env bash
# Runs a program in a folder, fpm's `--runner "tools/run_in.sh FOLDER"`: run_in.sh FOLDER PROGRAM ...

set -euo pipefail
program=$(realpath "$2")
cd "$1"
shift 2
exec "$program" "$@"
