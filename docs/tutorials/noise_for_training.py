# ---
# jupyter: {jupytext: {text_representation: {extension: .py, format_name: percent}}}
# ---

# %% [markdown]
# # Tutorial: noise for a training
#
# A network that is trained on rendered images meets noise for the first time when it sees a real
# camera. This tutorial adds the noise of a camera to rendered images, checks that it follows the
# physics, and puts it into a training pipeline.

# %% [markdown]
# ## A rendered image
#
# A bright body before a black sky, in [0, 1] and linear in light: (batch, channel, row, column), as
# torch has it.

# %%
import matplotlib.pyplot as plt
import torch
import visaug

rows, columns = torch.meshgrid(torch.arange(128.0), torch.arange(128.0), indexing="ij")
body = (rows - 64).abs() + (columns - 64).abs() < 45
clean = torch.where(body, 0.15 + 0.6 * columns / 128, 0.01)[None, None]
clean.shape

# %% [markdown]
# ## One camera, three exposures
#
# `VISNoise` is a `torch.nn.Module` and a kornia augmentation. A camera is named, loaded from a file,
# or measured (see the next tutorial). `exposure` is the share of the light that saturates the sensor:
# less light, the same brightness, more noise.

# %%
torch.manual_seed(0)
figure, axes = plt.subplots(1, 4, figsize=(10, 2.8), layout="constrained")
axes[0].imshow(clean[0, 0], cmap="gray", vmin=0, vmax=1)
axes[0].set_title("rendered")
for panel, exposure in zip(axes[1:], (1.0, 0.1, 0.01)):
    noisy = visaug.VISNoise("sony_imx174", exposure=exposure)(clean)
    panel.imshow(noisy[0, 0], cmap="gray", vmin=0, vmax=1)
    panel.set_title(f"exposure {exposure:g}")
for panel in axes:
    panel.set_axis_off()
figure

# %% [markdown]
# ## Is it physical?
#
# Shot noise has a variance that grows in proportion to the signal; read noise adds a constant. A plot
# of variance against mean, the photon transfer curve, is therefore a straight line. Two exposures of
# the same uniform image differ by temporal noise alone, so half the variance of their difference is
# its variance. `fixed_pattern="camera"` keeps one individual camera for both, and `gain_db=0` its
# gain, which this camera file otherwise draws anew for each image.

# %%
noise = visaug.VISNoise("sony_imx174", exposure=0.05, gain_db=0, fixed_pattern="camera")
means, variances = [], []
for level in torch.linspace(0.05, 0.9, 8):
    first, second = noise(torch.full((2, 1, 256, 256), float(level)))
    means.append(float((first + second).mean() / 2))
    variances.append(float((first - second).var() / 2))
slope = (variances[-1] - variances[0]) / (means[-1] - means[0])
figure, axis = plt.subplots(figsize=(4.5, 3.2), layout="constrained")
axis.plot(means, variances, "o")
axis.axline((means[0], variances[0]), slope=slope, color="gray")
axis.set(xlabel="mean / full scale", ylabel="variance / full scale squared", title="photon transfer")
figure

# %% [markdown]
# The slope is one over the number of electrons at full scale. The camera file has the same number:
# its converter ends at 4095 DN, of which the black level is no signal, and only a twentieth of the
# light is used.

# %%
camera = visaug.Camera.load("sony_imx174")
sensor = camera.values()
full_scale_e = 0.05 * sensor["gain_e_per_dn"] * (2**camera.bit_depth - 1 - sensor["black_level_dn"])
print(f"electrons at full scale: {1 / slope:.0f} from the slope, {full_scale_e:.0f} from the camera file")

# %% [markdown]
# ## In a training
#
# A network should meet a range of conditions. Gain and exposure are drawn for each image from the
# ranges that are given; fixed patterns are drawn anew, as if each image came from another camera of
# the type. The draws can be kept and replayed.

# %%
augment = visaug.VISNoise("sony_imx174", gain_db=(0, 24), exposure=(0.02, 1.0), p=0.8)
batch = clean.expand(8, 1, 128, 128)
noisy = augment(batch)
again = augment(batch, params=augment._params)
print(f"residual noise per image: {(noisy - batch).std(dim=(1, 2, 3)).numpy().round(3)}")
print(f"replayed bit by bit: {torch.equal(noisy, again)}")

# %% [markdown]
# Several cameras are a list, of which each image gets one:
# `visaug.VISNoise(["sony_imx174", "star_tracker"])`. The adapters for torchvision, albumentations and
# ultralytics take the same options, see [Augment images](../augment.md). Labels need no change: noise
# moves nothing.
