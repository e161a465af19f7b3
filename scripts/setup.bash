# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
#
# Prepares .venv in this checkout; sourced by the other scripts, which then call set_up.
#
# All that is installed is named with its hash in uv.lock, and uv itself in scripts/uv.txt. What is
# downloaded and compiled is kept in the user's cache, for all checkouts. A complete installation
# leaves a stamp that says what it was made from.

set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
venv=$root/.venv
log=$venv/install.log

fail() {
  printf '%s: %s\n' "${0##*/}" "$1" >&2
  exit 1
}

# Set "network_variables" to those by which this machine reaches registries, as NAME=VALUE.
find_network_variables() {
  local name
  network_variables=()
  for name in "${!PIP_@}" "${!UV_@}" "${!npm_config_@}" "${!NPM_CONFIG_@}" \
    SSL_CERT_FILE SSL_CERT_DIR NODE_EXTRA_CA_CERTS \
    http_proxy https_proxy no_proxy HTTP_PROXY HTTPS_PROXY NO_PROXY TMPDIR; do
    [[ -z ${!name-} ]] || network_variables+=("$name=${!name}")
  done
}

# Bring .venv up to date; "set_up dev" adds the tools that tests and checks need, "set_up bench" also
# what only benchmarks compare with.
set_up() {
  # A parent process that runs on ROS wheels hands down the paths of its own environment.
  if [[ -n ${_ROS_WHEELS_BOOTSTRAP_COMPLETE-} ]]; then
    unset _ROS_WHEELS_BOOTSTRAP_COMPLETE LD_LIBRARY_PATH AMENT_PREFIX_PATH
  fi
  if [[ -n ${ROS_DISTRO-}${AMENT_PREFIX_PATH-} ]]; then
    fail "ROS 2 is sourced in this shell, so use colcon instead: cd '$root' &&\
 rosdep install --from-paths . --ignore-src -y && colcon build && source install/setup.bash &&\
 ros2 run bt_agents_tools bt-agents demo"
  fi
  (
    if ! flock --nonblock 9; then
      echo "Waiting for another install into .venv to end ..."
      flock 9
    fi
    install_bt_agents "${1:-run}"
  ) 9>"$venv.lock"
}

install_bt_agents() {
  # Inexact, as uv takes what the ROS wheels bring for packages that are too many.
  local kind=$1 made_from works=yes packages=(--all-extras --inexact) stamps=(run)
  made_from=$(describe_inputs)
  "$venv/bin/python" -I -S -c '' 2>/dev/null || works=no
  if [[ $works == yes && -e $venv/$kind.stamp && $(<"$venv/$kind.stamp") == "$made_from" ]]; then
    return
  fi

  find_python_and_compiler
  if [[ $works == no || ! -e $venv/run.stamp ]]; then
    rm -rf "$venv"
    mkdir "$venv"
    echo "Installing about 700 MB into .venv; the first time takes one to two minutes"
  fi
  rm -f "$venv"/*.stamp
  find_uv
  if [[ ! -e $venv/pyvenv.cfg ]]; then
    step "Creating .venv with $python" "$uv" venv --allow-existing --python "$python" "$venv"
  fi
  case $kind in
    dev) packages+=(--group dev) stamps+=(dev) ;;
    bench) packages+=(--group dev --group bench) stamps+=(dev bench) ;;
  esac
  step "Installing ROS 2" "$uv" sync --project "$root" --frozen --no-install-project "${packages[@]}"
  find_wheel
  step "Installing bt-agents" install_wheel
  for kind in "${stamps[@]}"; do
    printf '%s\n' "$made_from" >"$venv/$kind.stamp"
  done
}

# Install the wheel, and have Python take the modules of the checkout.
install_wheel() {
  local folder
  "$uv" pip install --python "$venv/bin/python" --no-deps --reinstall "$wheel"
  dirname "$root"/*/setup.py >"$(echo "$venv"/lib/python3*/site-packages)/bt_agents_checkout.pth"
  for folder in bt_agents_bringup experiments trees; do
    rm -rf "$venv/share/bt_agents_${folder#bt_agents_}"
    ln -s "../../$folder" "$venv/share/bt_agents_${folder#bt_agents_}"
  done
}

# Install the lowest versions that pyproject.toml allows, in place of those of the lock.
install_lowest() {
  local lowest=$venv/lowest.txt compiled
  # Versions that are older than this Python have no wheel for it.
  compiled=(aiohttp matplotlib numpy psycopg pyarrow pyyaml zstandard)
  export UV_SYSTEM_CERTS=1 UV_PYTHON_DOWNLOADS=never
  rm -f "$venv"/*.stamp
  # The ROS wheels are built together, so they have no lowest versions of their own.
  "$venv/bin/uv" export --project "$root" --frozen --all-extras --no-hashes --no-emit-project --quiet |
    grep '^ros-' >"$lowest.ros"
  "$venv/bin/uv" pip compile --quiet --python "$venv/bin/python" --all-extras --resolution lowest-direct \
    "${compiled[@]/#/--only-binary=}" --constraints "$lowest.ros" --output-file "$lowest" \
    "$root/pyproject.toml" >/dev/null
  "$venv/bin/uv" pip install --quiet --python "$venv/bin/python" --requirements "$lowest"
}

describe_inputs() {
  cd "$root"
  pwd
  find pyproject.toml uv.lock scripts/uv.txt cmake bt_agents_interfaces ./*/package.xml ./*/setup.py \
    -type f -print0 | LC_ALL=C sort -z | xargs -0 sha256sum | sha256sum
}

# Set "cache" to where uv and what it makes are kept.
find_cache() {
  cache=${XDG_CACHE_HOME:-${HOME:+$HOME/.cache}}/bt-agents
  if [[ $cache == /bt-agents ]] || ! mkdir -p "$cache" 2>/dev/null || [[ ! -w $cache ]]; then
    cache=$root/build/cache
    mkdir -p "$cache"
  fi
  export UV_CACHE_DIR=${UV_CACHE_DIR:-$cache/uv}
}

# Set "uv" to the program.
find_uv() {
  find_cache
  export UV_PROJECT_ENVIRONMENT=$venv UV_PYTHON_DOWNLOADS=never UV_SYSTEM_CERTS=1

  local requirements=$root/scripts/uv.txt folder
  folder=$cache/uv-$(sha256sum "$requirements" | cut -c -12)
  uv=$folder/bin/uv
  if ! "$uv" --version >/dev/null 2>&1; then
    step "Installing uv" keep "$folder" install_uv "$requirements"
  fi
}

install_uv() {
  "$python" -m venv "$2"
  "$2/bin/python" -m pip install --disable-pip-version-check --require-hashes --requirement "$1"
}

# Set "wheel" to the one of this checkout without its Python modules and data, which is built for
# each interfaces, build tools, metadata and Python once.
find_wheel() {
  local requirements=$venv/build-requirements.txt folder
  "$uv" export --project "$root" --frozen --only-group build --quiet --output-file "$requirements" \
    >/dev/null
  folder=$cache/wheels/$(describe_wheel "$requirements" | sha256sum | cut -c -16)
  if [[ ! -e $folder ]]; then
    mkdir -p "$cache/wheels"
    find "$cache/wheels" -mindepth 1 -maxdepth 1 -mtime +60 -exec rm -rf {} +
    step "Compiling the interfaces" keep "$folder" build_wheel "$requirements"
  fi
  wheel=$(echo "$folder"/*.whl)
}

describe_wheel() {
  cd "$root"
  "$venv/bin/python" -I -S -c '
import json, sys, sysconfig, tomllib
project = tomllib.load(open("pyproject.toml", "rb"))
print(sysconfig.get_config_var("SOABI"), sysconfig.get_platform())
print(json.dumps([project["project"], project["build-system"], project["tool"]["scikit-build"]]))'
  find LICENSE cmake bt_agents_interfaces ./*/package.xml ./*/setup.py -type f -print0 |
    LC_ALL=C sort -z | xargs -0 sha256sum
  grep -v '^#' "$1"
}

build_wheel() {
  local setup options=(-C cmake.define.BT_AGENTS_OF_CHECKOUT=ON)
  for setup in "$root"/*/setup.py; do
    options+=(-C "wheel.exclude=$(basename "$(dirname "$setup")")/**")
  done
  "$uv" build --wheel --python "$venv/bin/python" --build-constraints "$1" --require-hashes \
    "${options[@]}" --out-dir "$2" "$root"
}

# keep FOLDER COMMAND...: have a command fill a folder, whose path follows its arguments; the
# folder is there once it is complete, also when another checkout makes the same one.
keep() {
  local folder=$1
  shift
  rm -rf "$folder.$$"
  "$@" "$folder.$$"
  mv -T "$folder.$$" "$folder" 2>/dev/null || rm -rf "$folder.$$"
}

# Set "python" to the first one that can be used; say in one sentence what is missing.
find_python_and_compiler() {
  local candidate version lacks first_version='' first_lacks='' missing=() packages=()
  if [[ $(uname -sm) != "Linux x86_64" ]]; then
    fail "the ROS 2 wheels run on Linux x86_64 and this is $(uname -sm); install ROS 2 Jazzy,\
 source it, and run this again to see the commands for colcon"
  fi

  python=''
  for candidate in ${BT_AGENTS_PYTHON:-python3.13 python3.12 python3.11 python3.14 python3}; do
    read -r version lacks < <("$candidate" -I -c '
import importlib.util, pathlib, sys, sysconfig
if (3, 11) <= sys.version_info < (3, 15):  # the versions that the ROS 2 wheels exist for
    venv = importlib.util.find_spec("venv") and importlib.util.find_spec("ensurepip")
    headers = pathlib.Path(sysconfig.get_path("include"), "Python.h").exists()
    print("%d.%d" % sys.version_info[:2], "" if venv else "venv", "" if headers else "dev")
' 2>/dev/null) || continue
    if [[ -z $lacks ]]; then
      python=$candidate
      break
    elif [[ -z $first_version ]]; then
      first_version=$version first_lacks=$lacks
    fi
  done

  if [[ -z $python && -z $first_version ]]; then
    missing+=("a Python from 3.11 to 3.14")
    # Where there is an older one, the package python3 is that one.
    version=$(command -v python3 >/dev/null && echo 3.11 || echo 3)
    packages+=("python$version" "python$version-venv" "python$version-dev")
  elif [[ -z $python ]]; then
    for lacks in $first_lacks; do
      missing+=("the ${lacks/dev/headers} of Python $first_version")
      packages+=("python$first_version-$lacks")
    done
  fi
  if ! command -v "${CC:-cc}" >/dev/null || ! command -v "${CXX:-c++}" >/dev/null; then
    missing+=("a C and C++ compiler")
    packages+=(g++)
  fi
  if ((${#missing[@]})); then
    printf -v lacks '%s, ' "${missing[@]}"
    fail "missing: ${lacks%, }; on Debian or Ubuntu: sudo apt install ${packages[*]}"
  fi
}

# step TITLE COMMAND...: run a command with its output in the log, and its time on the terminal.
step() {
  local title=$1 began=$SECONDS ticker='' status=0
  shift
  printf '%s ...' "$title"
  if [[ -t 1 ]]; then
    while sleep 1 && kill -0 $$ 2>/dev/null; do
      printf '\r%s ... %d s' "$title" $((SECONDS - began))
    done &
    ticker=$!
  fi
  "$@" >>"$log" 2>&1 || status=$?
  if [[ -n $ticker ]]; then
    { kill "$ticker" && wait "$ticker"; } 2>/dev/null || true
    printf '\r%s ...' "$title"
  fi
  if ((status)); then
    printf ' failed after %d s\n' $((SECONDS - began))
    tail -n 25 "$log" | sed 's/^/  | /' >&2
    fail "'$title' failed; everything it said is in $log"
  fi
  printf ' done in %d s\n' $((SECONDS - began))
}
