#!/usr/bin/env bash
# Removes objects of programs (app, tests, examples) that are older than the library they were
# compiled against. fpm 0.12 rebuilds what depends on a changed module only within one invocation:
# after `fpm run` has rebuilt the library, `fpm test` would keep tests that were linked to the old one.
# It is of the package in folder $1, if one is given.

set -euo pipefail
cd "$(dirname "$0")/../${1:-.}"

for objects in build/gfortran_*/calor build/mpifort_*/calor-mpi; do
  [[ -d $objects ]] || continue # nothing has been built yet
  newest=$(find "$objects" -name 'src_*.o' -printf '%T@ %p\n' 2>/dev/null | sort -n | tail -n 1)
  [[ -n $newest ]] || continue
  find "$objects" \( -name 'test_*.o' -o -name 'app_*.o' -o -name 'example_*.o' \) \
    ! -newer "${newest#* }" -exec rm -f {} {}.digest \;
done
