# ---
# jupyter: {jupytext: {text_representation: {extension: .py, format_name: percent}}}
# ---

# %% [markdown]
# # Tutorial: characterize a camera
#
# The package contains frames of a real 12-bit CCD (Basler AG, 2011, CC BY-SA 3.0; crops of the EMVA
# 1288 reference set). This tutorial measures its parameters from these frames, looks at the fits, and
# writes a camera file.

# %% [markdown]
# ## The frames
#
# A frame set is a folder with images and a table `frames.csv` with the conditions of each: see [Bring
# your frames](../frames.md).

# %%
import visaug

frames = visaug.FrameSet.load("visaug/data/ccd12")
print(frames)
for group in frames.groups()[:4]:
    print(
        f"{group.kind} {group.exposure_s:g} s, {group.photons} photons per pixel: {len(group.indices)} frames"
    )

# %% [markdown]
# ## Parameters with intervals
#
# `characterize` estimates every parameter that the frames determine, each with a 95 % interval, and
# says what is not determined.

# %%
found = visaug.characterize(frames)
for name in ("gain_e_per_dn", "quantum_efficiency", "read_noise.sigma_e", "prnu.pixel", "dsnu.pixel_e"):
    estimate = found[name]
    print(f"{name:20} {estimate.value:9.4g} [{estimate.low:.4g}, {estimate.high:.4g}] {estimate.unit}")
for name, needs in list(found.not_determined.items())[:3]:
    print(f"not determined: {name} (needs {needs})")

# %% [markdown]
# ## Look at the fit
#
# Variance against mean of the flat frames: the slope is the gain, the intercept the dark noise.

# %%
found.plot_photon_transfer()

# %% [markdown]
# Warnings name what they spoil. Read them before the numbers are used.

# %%
for warning in found.warnings[:3]:
    print("-", warning)

# %% [markdown]
# ## Use the camera
#
# `found.camera` is a camera as any other: to add noise to images, or to compare it with the frames in
# the [next tutorial](find_missing_effect.md). `found.save_camera("camera.yaml")` writes it.

# %%
print(found.to_camera_yaml()[:400])

# %%
import torch

torch.manual_seed(0)
noise = visaug.VISNoise(found.camera, exposure=0.1)
noise(torch.full((1, 1, 64, 64), 0.5)).std()
