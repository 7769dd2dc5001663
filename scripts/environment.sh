# Sourced by scripts/demo, scripts/docs and scripts/test with a list of extras, such as `train` or `train,lab,test`:
# makes or reuses .venv, leaves $python, stays off the network after. A stamp holds the hash of what says what to install
# and the extras so far; a call that needs no other installs nothing.

extras="${1:-test}"

root="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)"
cd "$root"
venv="$root/.venv"
python="$venv/bin/python"
stamp="$venv/.installed"

suits() { # a Python that is 3.10 or newer and can make a virtual environment
  command -v "$1" >/dev/null 2>&1 && "$1" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 10))' >/dev/null 2>&1
}

find_python() {
  local name
  for name in ${PYTHON:-} python3 python3.{10,11,12,13,14,15} python; do
    if suits "$name"; then echo "$name"; return; fi
  done
  echo "visaug: needs Python 3.10 or newer with the venv module; none was found (set PYTHON=/path/to/python)" >&2
  exit 2
}

project="$(cat pyproject.toml setup.py | cksum)"
if [ ! -x "$python" ] || ! "$python" -c '' 2>/dev/null; then
  found="$(find_python)"
  echo "Making .venv with $("$found" --version) ..."
  "$found" -m venv --clear "$venv"
fi
had=""
if [ -f "$stamp" ] && [ "$(head -n 1 "$stamp")" = "$project" ]; then had="$(tail -n 1 "$stamp")"; fi
wanted=""
for name in ${extras//,/ }; do
  case ",$had," in *",$name,"*) ;; *) wanted="$wanted,$name" ;; esac
done
if [ -n "$wanted" ]; then
  echo "Installing visaug with the extras ${extras} into .venv (once; up to 6 GB with the default build of torch) ..."
  "$python" -m pip install --quiet --disable-pip-version-check -e ".[$extras]"
  printf '%s\n%s\n' "$project" "$had$wanted" >"$stamp"
fi

# No weights, fonts or telemetry are fetched, and nobody's settings are read or changed.
export YOLO_OFFLINE=1 YOLO_AUTOINSTALL=0 YOLO_CONFIG_DIR="$venv/share/ultralytics"
export MPLBACKEND=Agg
mkdir -p "$YOLO_CONFIG_DIR"
