# Sourced by scripts/demo and scripts/test: makes or reuses .venv, leaves $python, stays off the network after.
# The second call installs nothing: a stamp holds the hash of what says what to install.

root="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)"
cd "$root"
venv="$root/.venv"
python="$venv/bin/python"
stamp="$venv/.installed"

suits() { # a Python that is 3.11 or newer and can make a virtual environment
  command -v "$1" >/dev/null 2>&1 && "$1" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1
}

find_python() {
  local name
  for name in ${PYTHON:-} python3 python3.{11,12,13,14,15} python; do
    if suits "$name"; then echo "$name"; return; fi
  done
  echo "visaug: needs Python 3.11 or newer with the venv module; none was found (set PYTHON=/path/to/python)" >&2
  exit 2
}

what_to_install="$(cat pyproject.toml setup.py | cksum)"
if [ ! -x "$python" ] || ! "$python" -c '' 2>/dev/null; then
  found="$(find_python)"
  echo "Making .venv with $("$found" --version) ..."
  "$found" -m venv --clear "$venv"
fi
if [ ! -f "$stamp" ] || [ "$(cat "$stamp")" != "$what_to_install" ]; then
  echo "Installing visaug with everything but the cluster into .venv (once, about 6 GB) ..."
  "$python" -m pip install --quiet --disable-pip-version-check -e '.[train,lab,test]'
  echo "$what_to_install" >"$stamp"
fi

# No weights, fonts or telemetry are fetched, and nobody's settings are read or changed.
export YOLO_OFFLINE=1 YOLO_AUTOINSTALL=0 YOLO_CONFIG_DIR="$venv/share/ultralytics"
export PYRIGHT_PYTHON_IGNORE_WARNINGS=1 MPLBACKEND=Agg
mkdir -p "$YOLO_CONFIG_DIR"
