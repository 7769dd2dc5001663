# ---
# jupyter: {jupytext: {text_representation: {extension: .py, format_name: percent}}}
# ---

# %% [markdown]
# # Tutorial: find the missing effect
#
# A camera file states gain, read noise and fixed patterns. The frames show something that it does not
# explain. This tutorial hides an effect in simulated frames, tests the camera file against them,
# identifies the effect, and checks the corrected camera.

# %% [markdown]
# ## A camera and its frames
#
# With a real camera you would load both: `visaug.Camera.load("camera.yaml")` and
# `visaug.FrameSet.load("frames/")`. Here a small sensor takes 9 bias, 6 dark and 12 flat frames, with
# row noise that its file does not contain.

# %%
import numpy as np
import visaug
from visaug.frames import FrameRecord

camera = visaug.Camera.load(
    {
        "resolution": [48, 64],
        "bit_depth": 14,
        "quantum_efficiency": 0.55,
        "gain_e_per_dn": 0.7,
        "black_level_dn": 120,
        "full_well_e": 9000,
        "read_noise": {"sigma_e": 3.0, "shape": -0.1},
        "dark_current": {"a_e_per_s": 0.2, "b_per_c": 0.1},
        "prnu": {"column": 0.002, "row": 0.0015, "pixel": 0.006},
        "dsnu": {"column_e": 1.0, "row_e": 0.4, "pixel_e": 1.2},
    }
)
settings = [("bias", 1e-5, None)] * 9  # kind, exposure in s, photons per pixel
settings += [("dark", seconds, None) for seconds in (0.2, 2.0) for _ in range(3)]
settings += [("flat", 0.01, photons) for photons in (100.0, 1000.0, 4000.0, 9000.0) for _ in range(3)]
plan = [
    FrameRecord(i, f"{i}", kind, seconds, temperature_c=20.0, photons=photons)
    for i, (kind, seconds, photons) in enumerate(settings)
]

# %%
true_camera = camera.with_effect("row_noise", sigma_e=1.4)
frames = visaug.simulate(
    true_camera, visaug.FrameSet.from_arrays(plan, np.zeros((len(plan), 48, 64), np.uint16)), seed=3
)
frames

# %% [markdown]
# ## Compare
#
# `compare` takes the same frames with the camera file, computes several hundred statistics of both,
# and tests whether the camera explains the measured ones. The p-value is the probability of a
# deviation at least as large if the camera file were complete.

# %%
comparison = visaug.compare(camera, frames)
print(comparison)
for line in comparison.differences(4):
    print(f"{line['view']:20} {line['statistic']:24} z = {line['z']:.1f}")

# %% [markdown]
# `z` is the difference between measured and modelled in standard deviations.

# %% [markdown]
# ## Diagnose
#
# `diagnose` refits the parameters of the camera file, tries the effects of the catalogue, and accepts
# what explains the frames. To save time, this tutorial tries two of them with few simulated sets;
# leave `without` and `sets` out to try all.

# %%
from visaug.effects.catalogue import catalogue

tried = {"row_noise", "flicker_noise"}
others = [name for name in catalogue() if name not in tried]
diagnosis = visaug.diagnose(camera, frames, without=others, sets=60)
print("accepted:", diagnosis.accepted)
for ranked in diagnosis.ranking[:1]:
    for name, estimate in ranked.parameters.items():
        interval = f"[{estimate.low:.3g}, {estimate.high:.3g}]"
        print(f"{ranked.effect}.{name}: {estimate.value:.3g} {interval} {estimate.unit}")

# %% [markdown]
# The true value is 1.4 e-. The error is 1 for the camera file as given, and 0 where the corrected
# camera is as close to the frames as a second camera of the same type.

# %%
error = diagnosis.to_json()["error"]
low, high = error["interval_after"]
print(f"error: {error['before']} before, {error['after']:.2f} after, 95 % interval {low:.2f} to {high:.2f}")
print(f"camera explains the frames: {diagnosis.adequate_before} before, {diagnosis.adequate_after} after")

# %% [markdown]
# ## Use the corrected camera
#
# `diagnosis.camera` is the camera with the effect. `diagnosis.report("diagnosis.html")` writes
# everything as one page with figures, and `diagnosis.to_frame()` gives the ranking of all candidates
# as a pandas DataFrame.

# %%
noise = visaug.VISNoise(diagnosis.camera)
diagnosis.camera.effect_names
