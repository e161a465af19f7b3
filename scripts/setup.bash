# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
#
# Prepares .venv in this checkout; sourced by the other scripts, which then call set_up.
#
# What has been installed completely leaves a stamp that says what it was made from. Without a
# stamp the environment is made anew, with another one it is brought up to date.

set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
venv=$root/.venv
log=$venv/install.log

fail() {
  printf '%s: %s\n' "${0##*/}" "$1" >&2
  exit 1
}

# Bring .venv up to date; "set_up dev" adds the tools that tests and checks need.
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
  export PIP_DISABLE_PIP_VERSION_CHECK=1
  (
    if ! flock --nonblock 9; then
      echo "Waiting for another install into .venv to end ..."
      flock 9
    fi
    install_bt_agents
    if [[ ${1-} == dev ]]; then
      install_tools
    fi
  ) 9>"$venv.lock"
}

install_bt_agents() {
  local stamp=$venv/bt-agents.stamp made_from works=yes
  made_from=$(describe_inputs)
  "$venv/bin/python" -I -S -c '' 2>/dev/null || works=no
  if [[ $works == yes && -e $stamp && $(<"$stamp") == "$made_from" ]]; then
    return
  fi

  find_python_and_compiler
  if [[ $works == no || ! -e $stamp ]]; then
    rm -rf "$venv"
    mkdir "$venv"
    step "Creating .venv with $python" "$python" -m venv "$venv"
  fi
  rm -f "$stamp"
  # Editable: the Python modules stay in the checkout, only the interfaces are compiled.
  step "Installing ROS 2 and bt-agents" "$venv/bin/python" -m pip install --editable "$root"
  local folder
  for folder in bt_agents_bringup experiments trees; do
    ln -sfn "../../$folder" "$venv/share/bt_agents_${folder#bt_agents_}"
  done
  printf '%s\n' "$made_from" >"$stamp"
}

install_tools() {
  local stamp=$venv/tools.stamp tools
  mapfile -t tools < <("$venv/bin/python" -I -S -c '
import sys, tomllib
project = tomllib.load(open(sys.argv[1], "rb"))["project"]
print(*project["optional-dependencies"]["dev"], sep="\n")' "$root/pyproject.toml")
  if [[ -e $stamp && $(<"$stamp") == "${tools[*]}" ]]; then
    return
  fi
  step "Installing the tools for tests" "$venv/bin/python" -m pip install "${tools[@]}"
  printf '%s\n' "${tools[*]}" >"$stamp"
}

describe_inputs() {
  cd "$root"
  pwd
  find pyproject.toml cmake bt_agents_interfaces ./*/package.xml -type f -print0 |
    LC_ALL=C sort -z | xargs -0 sha256sum | sha256sum
}

# Set "python" to the first one that can be used; say in one sentence what is missing.
find_python_and_compiler() {
  local candidate version lacks first_version='' first_lacks='' missing=() packages=()
  if [[ $(uname -sm) != "Linux x86_64" ]]; then
    fail "the ROS 2 wheels run on Linux x86_64 and this is $(uname -sm); install ROS 2 Jazzy,\
 source it, and run this again to see the commands for colcon"
  fi

  python=''
  for candidate in python3.13 python3.12 python3.11 python3; do
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
