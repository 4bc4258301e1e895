#!/usr/bin/env bash
# Puts in place what calor is built with, and does nothing for what is there already.
#
#   tools/set_up.sh          compiler, libraries, fpm, test-drive: all that building and testing take
#   tools/set_up.sh lint     the linter, the formatter and what checks the spelling of documents
#   tools/set_up.sh docs     FORD, which makes pages of the modules
#   tools/set_up.sh vtk      VTK's reader for Python, which the continuous integration opens files with
#   tools/set_up.sh distributed  PETSc, PARPACK and Open MPI, for calor-mpi
#   tools/set_up.sh bench    programs of others that `make bench` measures beside calor
#
# Debian packages are installed where that is allowed (root); elsewhere the script says which are
# missing and stops with status 1. Python programs go into private environments, pinned.

set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

readonly FPM='fpm==0.12.0'
readonly LINTERS=('fortitude-lint==0.10.0' 'findent==4.3.6' 'codespell==2.4.3')
readonly FORD='ford==7.0.13'
readonly VTK='vtk==9.5.2'
readonly PEERS=('numpy==2.4.6' 'scipy==1.17.1' 'scikit-fem==12.0.2' 'mkl==2026.2.0'
  'treverhines-rbf==2025.7.4.1')

readonly TEST_DRIVE_URL='https://github.com/fortran-lang/test-drive.git'
readonly TEST_DRIVE_TAG='v0.5.0'
readonly TEST_DRIVE_PATIENCE=10 # seconds until its host counts as out of reach

readonly TEST_DRIVE='build/dependencies/test-drive'
readonly STAND_IN='tools/test-drive-stand-in'

say() { printf 'set-up: %s\n' "$*"; }

fail() {
  printf 'set-up: %s\n' "$*" >&2
  exit 1
}

#--- What is there? ------------------------------------------------------------------------------

has_command() { command -v "$1" >/dev/null; }

# Whether the linker would find -l$1.
has_library() {
  local path
  if has_command gfortran; then
    path=$(gfortran -print-file-name="lib$1.so")
    [[ $path == */* ]]
  else
    compgen -G "/usr/lib/*-linux-gnu/lib$1.so" >/dev/null
  fi
}

# Debian's description of the serial HDF5, whichever flavour hdf5.pc itself points to; '' if absent.
serial_hdf5() { compgen -G '/usr/lib/*/pkgconfig/hdf5-serial.pc' | head -n 1 || true; }

has_hdf5() { [[ -n $(serial_hdf5) ]] || { has_command pkg-config && pkg-config --exists hdf5; }; }

# Whether private environment $1 holds the package pinned as $2 (name==version).
holds() {
  local name=${2%%==*}
  compgen -G "$1/lib/python3*/site-packages/${name//-/_}-${2##*==}.dist-info" >/dev/null
}

#--- Debian packages -----------------------------------------------------------------------------

# Names the packages among those the build needs that are missing. $1: 1 if the stand-in is used.
missing_packages() {
  has_command gfortran || echo gfortran
  has_command pkg-config || echo pkg-config
  has_command gnuplot || echo gnuplot-nox
  has_hdf5 || echo libhdf5-dev
  has_command h5diff || echo hdf5-tools
  has_library lapack || echo liblapack-dev
  has_library blas || echo libblas-dev
  has_library muparser || echo libmuparser-dev
  has_library arpack || echo libarpack2-dev
  has_library umfpack || echo libsuitesparse-dev
  if [[ $1 == 1 ]]; then has_library mctc-lib || echo libmctc-lib-dev; fi
  holds .venv "$FPM" || missing_python_packages
}

missing_python_packages() {
  has_command python3 || echo python3
  python3 -c 'import ensurepip, venv' 2>/dev/null || echo python3-venv
}

# Installs the packages given, or says that they are missing and stops.
install_packages() {
  (($# > 0)) || return 0
  local line="apt-get install --no-install-recommends $*"
  has_command apt-get || fail "missing (by their names in Debian): $*. Install them and run this again."
  [[ $(id -u) == 0 ]] || fail "packages are missing. As root, run: $line"
  say "$line"
  mkdir -p build
  export DEBIAN_FRONTEND=noninteractive
  { apt-get -qq update && apt-get -qq --yes install --no-install-recommends "$@"; } \
    >build/apt.log 2>&1 </dev/null || {
    tail -n 20 build/apt.log >&2
    fail "the packages could not be installed; the whole story is in build/apt.log"
  }
}

#--- Python programs in private environments -----------------------------------------------------

# Installs the pinned packages $2... into environment $1 if they are not there.
install_pinned() {
  local environment=$1 package
  local wanted=()
  shift
  for package in "$@"; do
    holds "$environment" "$package" || wanted+=("$package")
  done
  ((${#wanted[@]} > 0)) || return 0
  mapfile -t packages < <(missing_python_packages)
  install_packages "${packages[@]}"
  say "installing ${wanted[*]} into $environment"
  [[ -x $environment/bin/python ]] || python3 -m venv "$environment"
  # --no-deps: none of these needs another package for what is done with it here.
  "$environment/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps \
    "${wanted[@]}" || fail "pip could not install ${wanted[*]}"
}

# The same with what the packages need themselves.
install_with_needs() {
  local environment=$1 package missing=0
  shift
  for package in "$@"; do holds "$environment" "$package" || missing=1; done
  ((missing == 1)) || return 0
  mapfile -t packages < <(missing_python_packages)
  install_packages "${packages[@]}"
  say "installing $* into $environment"
  [[ -x $environment/bin/python ]] || python3 -m venv "$environment"
  "$environment/bin/python" -m pip install --quiet --disable-pip-version-check "$@" ||
    fail "pip could not install $*"
}

#--- test-drive ----------------------------------------------------------------------------------

# Fetches test-drive; fails where its host cannot be reached within a few seconds.
fetch_test_drive() {
  rm -rf "$TEST_DRIVE" "$TEST_DRIVE.part"
  mkdir -p "$(dirname "$TEST_DRIVE")"
  GIT_TERMINAL_PROMPT=0 timeout "$TEST_DRIVE_PATIENCE" \
    git -c advice.detachedHead=false clone --quiet --depth 1 --branch "$TEST_DRIVE_TAG" \
    "$TEST_DRIVE_URL" "$TEST_DRIVE.part" 2>/dev/null </dev/null || return 1
  mv "$TEST_DRIVE.part" "$TEST_DRIVE"
}

# Puts the stand-in where fpm looks for test-drive. fpm takes any git repository with a commit.
place_stand_in() {
  local module
  module=$(dpkg -L libmctc-lib-dev | grep '/mctc_env_testing\.mod$' | head -n 1) ||
    fail 'libmctc-lib-dev does not hold mctc_env_testing.mod'
  rm -rf "$TEST_DRIVE" "$TEST_DRIVE.part"
  cp -r "$STAND_IN" "$TEST_DRIVE.part"
  ln -s "$(dirname "$module")" "$TEST_DRIVE.part/include"
  git -C "$TEST_DRIVE.part" init --quiet 2>/dev/null
  git -C "$TEST_DRIVE.part" add .
  git -C "$TEST_DRIVE.part" -c user.name=calor -c user.email=calor@localhost \
    commit --quiet --no-gpg-sign --no-verify -m 'Stand-in for test-drive'
  mv "$TEST_DRIVE.part" "$TEST_DRIVE"
  say "test-drive's host cannot be reached; its twin in Debian's mctc-lib stands in for it"
}

#--- The tasks -----------------------------------------------------------------------------------

set_up_build() {
  local stand_in=0
  mkdir -p build/pkgconfig
  if [[ -L $TEST_DRIVE/include ]]; then
    stand_in=1
  elif [[ ! -f $TEST_DRIVE/fpm.toml ]]; then
    fetch_test_drive || stand_in=1
  fi

  mapfile -t packages < <(missing_packages "$stand_in")
  install_packages "${packages[@]}"
  install_pinned .venv "$FPM"
  if [[ $stand_in == 1 && ! -f $TEST_DRIVE/fpm.toml ]]; then place_stand_in; fi

  # fpm asks pkg-config for "hdf5", which may be an MPI flavour; here it gets the serial one.
  local description
  description=$(serial_hdf5)
  if [[ -n $description && $(readlink build/pkgconfig/hdf5.pc) != "$description" ]]; then
    ln -sf "$description" build/pkgconfig/hdf5.pc
  fi
}

# What calor-mpi takes beside. The serial HDF5 stays the one that calor itself is built with.
set_up_distributed() {
  local packages=()
  set_up_build
  has_command mpifort || packages+=(libopenmpi-dev)
  has_command mpirun || packages+=(openmpi-bin)
  has_library petsc_real && pkg-config --exists petsc || packages+=(libpetsc-real-dev)
  has_library parpack || packages+=(libparpack2-dev)
  install_packages "${packages[@]}"
}

case ${1:-build} in
  build) set_up_build ;;
  distributed) set_up_distributed ;;
  lint) install_pinned .venv "${LINTERS[@]}" ;;
  docs) install_with_needs .venv-docs "$FORD" ;;
  vtk) install_pinned .venv-vtk "$VTK" ;;
  bench) install_with_needs .venv-bench "${PEERS[@]}" ;;
  *) fail "unknown task '$1': build, lint, docs, vtk, bench or distributed" ;;
esac
