# Sourced by scripts/lowest and scripts/pythons: the tests that tell in minutes whether versions fit together.
fast_tests() { # fast_tests PYTHON
  PYTHONPATH="$PWD" MPLBACKEND=Agg OMP_NUM_THREADS=1 "$1" -m pytest -q -p no:cacheprovider tests/effects tests/core tests/camera \
    tests/frames/test_record_and_table.py tests/camera/test_simulation.py tests/characterization/test_emva.py tests/core/test_wording.py
}
test_tools="pytest pytest-timeout hypothesis opencv-python-headless"
