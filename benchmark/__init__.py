"""The benchmark of `visaug diagnose`: cameras with hidden effects, and a judge who counts the answers.

    python -m benchmark --help        # from the root of the checkout; not part of the installed package

Only `user_effects.py`, the file of a user, imports visaug: the package is judged by cameras that cannot share its mistakes.

- `camera.py`, `light.py`, `charge.py`, `readout.py`: a camera in NumPy and SciPy, after EMVA 1288 and Janesick's *Photon
  Transfer*; `effects.py`, `further.py`, `foreign.py`, `local.py` list the effects that can be hidden in it.
- `textbook/`: a second camera, written without sight of the first. `getframes_sets.py`, `pyxel_sets.py`: cameras of other
  authors. `real.py`: effects added to real frames. `pictures.py`: cameras that take 8-bit pictures.
- `recipes.py`, `strengths.py`, `calibrate.py`: which effect, on which camera, how strong. `sets.py`: frame sets on disk.
- `judge.py`: runs the program, counts right and wrong answers. `commands.py`: the command line.
"""
